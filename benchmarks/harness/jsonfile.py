"""results-3.11.json: the figures of every round with one Python, for further calculations."""

from __future__ import annotations

import json
from typing import Any

from benchmarks.harness.goals import GOALS, LOOPS
from benchmarks.harness.results import Idle, Results, Rounds

_DIGITS = 5


def to_json(results: Results) -> str:
    """The file's contents. Times are seconds, rates calls a second, lists go round by round."""
    sections = {
        "about": results.about,
        "versions": results.versions,
        "left_out": results.left_out,
        "goals": _goals(results),
        "calls": {
            workload: {name: _rounds(measures) for name, measures in by_name.items()}
            for workload, by_name in results.calls.items()
        },
        "idle_connections": {
            name: {str(count): _idle(found) for count, found in held.items()}
            for name, held in results.idle.items()
        },
        "start_up": results.start_up,
        "commands": results.commands,
        "imports": results.imports,
    }
    return _spaced(sections, depth=2) + "\n"


def from_json(text: str) -> Results:
    """The results of such a file."""
    found = json.loads(text)
    return Results(
        found["about"],
        found["versions"],
        found["left_out"],
        {
            workload: {
                name: {measure: Rounds(**each) for measure, each in measures.items()}
                for name, measures in by_name.items()
            }
            for workload, by_name in found["calls"].items()
        },
        {
            name: {int(count): Idle(each.pop("server_bytes"), each) for count, each in held.items()}
            for name, held in found["idle_connections"].items()
        },
        found["start_up"],
        found["commands"],
        found["imports"],
    )


def _goals(results: Results) -> list[dict[str, Any]]:
    rows = []
    for goal in GOALS:
        for number, (suffix, limit) in enumerate(zip(LOOPS, goal.limits, strict=True)):
            value = goal.measured(results, suffix)
            rows.append(
                {
                    "goal": goal.text + suffix,
                    "at_most" if goal.at_most else "at_least": limit,
                    "measured": value,
                    "met": None if value is None else goal.is_met(value, number),
                }
            )
    return rows


def _rounds(measures: dict[str, Rounds]) -> dict[str, dict[str, Any]]:
    return {
        measure: {"values": rounds.values, "ratios": rounds.ratios}
        for measure, rounds in measures.items()
    }


def _idle(found: Idle) -> dict[str, list[float]]:
    return {"server_bytes": found.memory, **found.measures}


def _spaced(value: Any, depth: int) -> str:
    """JSON with a line for each contender, whatever it holds."""
    if depth and isinstance(value, dict) and value:
        inner = (f"{json.dumps(key)}: {_spaced(each, depth - 1)}" for key, each in value.items())
        return "{\n" + ",\n".join(inner) + "\n}"
    return json.dumps(_rounded(value))


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
