"""The picture for README: latency and calls per second of all contenders."""

from __future__ import annotations

from benchmarks.harness import plot
from benchmarks.harness.results import Results
from benchmarks.harness.workloads import Workload

_PICTURED = (
    plot.Panel("latency of one call (p50)", "left of 1: faster"),
    plot.Panel("calls per second, 64 in flight", "right of 1: more"),
)


def picture(results: Results) -> str:
    """latency.svg."""
    columns = [
        (Workload(results.pinned), "p50"),
        (Workload(results.pinned, in_flight=64), "rate"),
    ]
    rows = []
    for name in results.calls[columns[0][0].key]:
        cells = [results.figure(workload, name, measure) for workload, measure in columns]
        ratios = tuple(cell.ratio if cell else None for cell in cells)
        rows.append(plot.Row(name, ratios, _kind(name)))
    rows.sort(key=lambda row: row.ratios[0] or 0)
    where = "one core" if results.pinned else "any core"
    footnote = (
        "blue: taskrpc; purple: limits, without what makes a call safe; grey: others."
        f" {results.about['cpu']}, {results.about['python']}, {results.about['date']}"
    )
    title = f"AddTwoInts, relative to a raw asyncio echo (= 1), client and server on {where}"
    return plot.bars(title, _PICTURED, rows, footnote)


def _kind(name: str) -> str:
    if name.startswith("taskrpc"):
        return "ours"
    return "limit" if name.startswith(("raw", "ideal")) else "peer"
