"""RESULTS.md: what was measured, where, and what came out."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks.contenders import BASELINE, CONTENDERS
from benchmarks.harness.goals import GOALS, LOOPS, Goal
from benchmarks.harness.results import Results
from benchmarks.harness.tables import TIMES, UNKNOWN, duration, ratio, significant, spread, table
from benchmarks.harness.workloads import IN_FLIGHT, PAYLOADS, Workload, size

_METHOD = """\
- Client and server are two processes (of the memory contender: one). Each round of small calls
  starts them anew, because two starts of one program may differ by a fifth in their speed. Each
  contender adds two integers, encoded and decoded as its users would, and echoes bytes; the raw
  ones only send bytes to and fro.
- **Every ratio is to the baseline, in the same round**: an `asyncio.Protocol` that echoes frames
  with four bytes of length, on asyncio's own loop. It handles all frames of one read together: the
  server answers them with one joined `write`, and a large frame is a list of chunks that is joined
  once. It is measured anew before every fourth turn. Tables show the median of the rounds' ratios,
  in brackets the least and the greatest.
- **Results before 22 November 2026 had a slower baseline** and cannot be compared with these: it
  called `write` once a frame, and collected large frames in a growing `bytearray`.
- The baseline's processes have seen no large message before; "large first" has, which makes glibc
  keep the memory that asyncio reads into and halves a call's time. Payloads are measured last,
  smaller ones first.
- In each round everybody's turn comes once, in another order each time, after a warm-up.
- What counts is measured with both processes pinned to **one core**. Unpinned, a call's latency is
  whatever the wake-up of another core costs: often two values far apart, by the system's mood.
- In flight: so many loops at a time, each making one call after the other; threads where the
  contender blocks. CPU is that of all processes of a contender, a third one's included."""


_QUIET = 0.5
"""The load average up to which a machine counts as idle."""
_FEW = 0.1
"""Cores that others may use meanwhile."""
_BUSY = (
    " **The machine was busy: do not compare these figures with those of an idle one.** The"
    " brackets in the tables show how much they vary."
)


def report(runs: Sequence[Results]) -> str:
    """The contents of RESULTS.md: the goals with each Python, then all tables of the first."""
    results = runs[0]
    numbers = ", ".join(
        f"[{name}]({name})" for name in (f"results-{run.python}.json" for run in runs)
    )
    parts = [
        "# Results",
        "Made by `make bench` (`python benchmarks/run.py`), never by hand."
        f" All numbers: {numbers}.",
        "![latency and calls per second, relative to raw asyncio](latency.svg)",
        "\n".join(f"- {_about(run)}" for run in runs),
        "## Goals",
        _goals(runs),
        "\n".join(_met(run) for run in runs),
        "`tests/test_steps.py` checks the twelfth goal by counting function calls: an exactly-once"
        " service costs the calls of other services nothing.",
        f"All tables below are of Python {results.python}.",
        f"## {'One core' if results.pinned else 'Any core'}",
        _calls(results, pinned=results.pinned),
        *(["## Any core", _calls(results, pinned=False)] if results.pinned else []),
        "## Payloads",
        _payloads(results),
        "## Idle connections",
        _idle(results),
        "## Start-up",
        _start_up(results),
        "## Method",
        _METHOD,
        "## Versions",
        _versions(results),
    ]
    return "\n\n".join(parts) + "\n"


def _about(results: Results) -> str:
    about = results.about
    return (
        f"{about['date']}, {about['cpu']}, {about['cores']} cores, {about['system']},"
        f" {about['python']}, commit {about['commit'] or 'unknown'};"
        f" {about['rounds']} rounds, {about['seconds']:g} s a measurement."
        + (" **A quick run: too short to quote.**" if about["quick"] else "")
        + _load(about)
    )


def _load(about: dict[str, Any]) -> str:
    """How busy the machine was, and whether that matters."""
    if "load" not in about:  # a run of before
        return ""
    others = about.get("others")
    meanwhile = "" if others is None else f"; during the run others used {others:g} cores"
    text = f" Load average at the start: {about['load']:g}{meanwhile}."
    return text + (_BUSY if about["load"] > _QUIET or (others or 0) > _FEW else "")


def _goals(runs: Sequence[Results]) -> str:
    head = [f"{TIMES} raw asyncio"]
    for loop in ("asyncio", "uvloop"):
        head += ["goal", *(f"{loop}, {run.python}" for run in runs)]
    rows = []
    for goal in GOALS:
        cells = [goal.text]
        for loop in range(len(LOOPS)):
            cells.append(f"{'≤' if goal.at_most else '≥'} {goal.limits[loop]:g}")
            cells += [_goal(goal, loop, run) for run in runs]
        rows.append(cells)
    return table(head, rows)


def _goal(goal: Goal, loop: int, results: Results) -> str:
    value = goal.measured(results, LOOPS[loop])
    if value is None:
        return "not measured"
    return f"{value:.2f}, {'met' if goal.is_met(value, loop) else '**not met**'}"


def _met(results: Results) -> str:
    """How many goals a run met."""
    met = [0] * len(LOOPS)
    for loop, suffix in enumerate(LOOPS):
        for goal in GOALS:
            value = goal.measured(results, suffix)
            met[loop] += value is not None and goal.is_met(value, loop)
    return (
        f"Of {len(GOALS)} goals, Python {results.python} meets {met[0]} on asyncio's loop"
        f" and {met[1]} on uvloop."
    )


def _names(results: Results) -> list[str]:
    measured = set().union(*results.calls.values())
    return [each.name for each in CONTENDERS if each.name in measured]


def _calls(results: Results, *, pinned: bool) -> str:
    head = ["AddTwoInts", "p50", f"p50 {TIMES}", f"p99 {TIMES}"]
    head += [f"calls/s at {count}" for count in IN_FLIGHT] + [f"CPU at 64 {TIMES}"]
    return table(head, [_call_row(results, name, pinned=pinned) for name in _names(results)])


def _call_row(results: Results, name: str, *, pinned: bool) -> list[str]:
    one, many = Workload(pinned), Workload(pinned, in_flight=64)
    latency = results.figure(one, name, "p50")
    rates = [results.figure(Workload(pinned, count), name, "rate") for count in IN_FLIGHT]
    return [
        name,
        duration(latency.value) if latency else UNKNOWN,
        spread(latency),
        ratio(results.figure(one, name, "p99")),
        *(
            f"{significant(rate.value)} ({ratio(rate)} {TIMES})" if rate else UNKNOWN
            for rate in rates
        ),
        ratio(results.figure(many, name, "cpu")),
    ]


def _payloads(results: Results) -> str:
    head = ["echo, MB/s one way", *map(size, PAYLOADS)]
    return table(head, [_payload_row(results, name) for name in _names(results)])


def _payload_row(results: Results, name: str) -> list[str]:
    cells = [name]
    for payload in PAYLOADS:
        found = results.figure(Workload(results.pinned, payload=payload), name, "rate")
        rate = (
            f"{significant(found.value * payload / 1e6)} ({ratio(found)} {TIMES})"
            if found
            else UNKNOWN
        )
        cells.append(rate)
    return cells


def _idle(results: Results) -> str:
    head = [
        "64 in flight",
        "idle",
        "bytes a connection",
        "p50",
        "p99",
        f"p99 {TIMES} its own without",
    ]
    rows = [
        [name, f"{count:,}", *_idle_cells(results, name, count)]
        for name, held in results.idle.items()
        for count in held
    ]
    return table(head, rows) if rows else "Not measured."


def _idle_cells(results: Results, name: str, count: int) -> list[str]:
    each = results.idle_bytes(name, count)
    p50, p99 = (results.idle_figure(name, count, measure) for measure in ("p50", "p99"))
    return [
        f"{each:,.0f}" if each is not None else UNKNOWN,
        duration(p50.value) if p50 else UNKNOWN,
        duration(p99.value) if p99 else UNKNOWN,
        spread(p99) if count else UNKNOWN,
    ]


def _start_up(results: Results) -> str:
    figures = {name: results.start_figure(name, BASELINE.name) for name in results.start_up}
    known = {name: found for name, found in figures.items() if found}
    servers = [
        [name, duration(known[name].value), spread(known[name])]
        for name in sorted(known, key=lambda name: known[name].value)
    ]
    commands = [
        [f"`{name}`", duration(statistics.median(seconds))]
        for name, seconds in results.commands.items()
    ]
    return "\n\n".join(
        [
            table(["start of a server to its first answer", "", f"{TIMES} raw asyncio"], servers),
            table(["command line, to its end", ""], commands),
            _imports(results),
        ]
    )


def _imports(results: Results) -> str:
    packages = dict.fromkeys(each for found in results.imports.values() for each in found)
    rows = [
        [package, *(_imported(found.get(package)) for found in results.imports.values())]
        for package in packages
    ]
    return table(["imports", *(f"`{name}`" for name in results.imports)], rows)


def _imported(found: tuple[int, float] | None) -> str:
    return f"{found[0]} modules, {duration(found[1])}" if found else "none"


def _versions(results: Results) -> str:
    known = ", ".join(f"{name} {version}" for name, version in sorted(results.versions.items()))
    return "\n".join([known + ".", *_left_out(results.left_out.items())])


def _left_out(items: Iterable[tuple[str, str]]) -> list[str]:
    return [f"\nLeft out: {name} ({why})." for name, why in items]
