"""GROWTH.md and growth.json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from benchmarks.growing.curves import Curve
from benchmarks.growing.topics import Topic
from benchmarks.harness.tables import UNKNOWN, significant, table

_METHOD = """\
- Every size is measured in fresh processes; with connections and payloads the server is a process
  of its own, with services and tasks one process is all. Nothing is pinned to a core.
- The exponent is the slope of a straight line through log cost over log size: 0 is constant,
  1 linear, 2 quadratic; for rates it is that of the time a call. "At the end" is the same over the
  last factor of hundred only, where fixed costs hide nothing. Noise is worth about 0.1.
- Costs are for one service, task, call or connection. So all n of them together cost n to the
  power of one more than the exponent: 1 here would be quadratic there.
- Tasks have a random priority from 1 to 10 and a random target, so that every change of the order
  plans the task behind it anew. The manager has a store in memory and a robot that is there at
  once; a task's run includes the account of why its estimate changed, over at most the
  4,096 last events."""


def report(about: dict[str, Any], found: Sequence[tuple[Topic, Sequence[Curve]]]) -> str:
    """The contents of GROWTH.md."""
    parts = [
        "# Growth",
        "Made by `python benchmarks/growth.py`, never by hand. All numbers:"
        " [growth.json](growth.json).",
        "![every cost over its size](growth.svg)",
        _about(about),
        "## Verdict",
        _verdict([curve for _, curves in found for curve in curves]),
    ]
    for topic, curves in found:
        parts += [f"## By {topic.title}", _table(curves)]
    return "\n\n".join([*parts, "## Method", _METHOD]) + "\n"


def to_json(about: dict[str, Any], found: Sequence[tuple[Topic, Sequence[Curve]]]) -> str:
    """The contents of growth.json."""
    topics = {
        topic.name: {curve.measure.name: _numbers(curve) for curve in curves}
        for topic, curves in found
    }
    return json.dumps({"about": about, "topics": topics}, indent=1, ensure_ascii=False) + "\n"


def _about(about: dict[str, Any]) -> str:
    text = (
        f"{about['date']}, {about['cpu']}, {about['cores']} cores, {about['system']},"
        f" {about['python']}, commit {about['commit'] or 'unknown'}."
    )
    return text + (" **A quick run: too short to quote.**" if about["quick"] else "")


def _verdict(curves: Sequence[Curve]) -> str:
    beyond = [curve for curve in curves if not curve.is_within]
    if not beyond:
        return f"All {len(curves)} costs grow no faster than they may."
    lines = [
        f"- {curve.measure.title}: {curve.exponent:+.2f}, at the end {curve.end_exponent:+.2f}"
        f" (at most {curve.measure.limit:g})"
        for curve in beyond
    ]
    many = f"{len(beyond)} of {len(curves)} costs grow faster than they may:"
    return "\n".join([many, "", *lines])


def _table(curves: Sequence[Curve]) -> str:
    sizes = curves[0].sizes
    head = ["cost", "unit", *(f"{size:,}" for size in sizes), "exponent", "at the end", "may be"]
    return table(head, [_row(curve) for curve in curves])


def _row(curve: Curve) -> list[str]:
    values = [significant(value) if value > 0 else UNKNOWN for value in curve.values]
    verdict = "" if curve.is_within else " **exceeded**"
    return [
        curve.measure.title,
        curve.measure.unit,
        *values,
        f"{curve.exponent:+.2f}",
        f"{curve.end_exponent:+.2f}",
        f"{curve.measure.limit:g}{verdict}",
    ]


def _numbers(curve: Curve) -> dict[str, Any]:
    return {
        "unit": curve.measure.unit,
        "values": {
            str(size): float(f"{value:.5g}")
            for size, value in zip(curve.sizes, curve.values, strict=True)
        },
        "exponent": round(curve.exponent, 3),
        "end_exponent": round(curve.end_exponent, 3),
        "limit": curve.measure.limit,
    }
