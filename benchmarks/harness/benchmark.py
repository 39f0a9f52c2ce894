"""One benchmark, from the first process to the last file."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.contenders import BASELINE
from benchmarks.harness import idle
from benchmarks.harness.contender import Contender
from benchmarks.harness.jsonfile import from_json, to_json
from benchmarks.harness.machine import Others, about
from benchmarks.harness.picture import picture
from benchmarks.harness.processes import CAN_PIN, ChildFailed, Pair
from benchmarks.harness.report import report
from benchmarks.harness.results import Results
from benchmarks.harness.rounds import TURNS, Field, run_rounds
from benchmarks.harness.sources import sources_digest
from benchmarks.harness.startup import measure_commands, measure_start_up
from benchmarks.harness.versions import version_of
from benchmarks.harness.workloads import phases


@dataclass(frozen=True)
class Settings:
    """How long and how much is measured."""

    rounds: int = 7
    seconds: float = 0.25
    """Of one measurement; its warm-up comes on top."""
    idle_counts: tuple[int, ...] = idle.COUNTS
    idle_rounds: int = 5
    idle_seconds: float = 1.0
    quick: bool = False


QUICK = Settings(
    rounds=1, seconds=0.04, idle_counts=(0, 1000), idle_rounds=1, idle_seconds=0.3, quick=True
)


WITH_WARM_UP = 1.2
"""How much longer a measurement takes with its warm-up."""
BETWEEN = 0.02
"""Seconds between two measurements."""
START = 0.4
"""Seconds in which a contender's server or both of its processes start and end."""
COMMANDS = 1.0
"""Seconds of the command lines of a round."""
HOLDING = 1.0
"""Seconds in which idle connections are opened and closed."""


def say(text: str) -> None:
    """Print the progress."""
    print(text, file=sys.stderr, flush=True)


def run(contenders: Sequence[Contender], settings: Settings) -> Results:
    """Measure these contenders, of which the baseline must be one."""
    others = Others()
    described = {**about(), "sources": sources_digest(), **asdict(settings)}
    results = Results(described, _versions(contenders))
    chosen = [each for each in contenders if not _leave_out(each, results)]
    minutes = expected_minutes(chosen, settings)
    say(f"Python {results.python}, {len(chosen)} contenders: takes about {minutes:.0f} min")
    with ExitStack() as stack:
        pairs = _started(chosen, stack, results)
        field = Field(pairs, results)
        run_rounds(
            field,
            phases(can_pin=CAN_PIN),
            rounds=settings.rounds,
            seconds=settings.seconds,
            results=results,
            say=say,
        )
        _measure_starts(field, settings, results)
    if settings.idle_counts:
        _attempt("idle connections", results, lambda: _measure_idle(chosen, settings, results))
    results.about["others"] = others.cores()
    return results


def _measure_starts(field: Field, settings: Settings, results: Results) -> None:
    rounds = settings.rounds

    def commands() -> None:
        for pair in field.pairs:
            if pair.contender.name == "taskrpc":
                measure_commands(pair, rounds=rounds, results=results)

    start_up = lambda: measure_start_up(field, rounds=rounds, results=results)  # noqa: E731
    _attempt("start-up", results, start_up)
    _attempt("command lines", results, commands)


def _measure_idle(chosen: Sequence[Contender], settings: Settings, results: Results) -> None:
    idle.measure_idle(
        [each for each in chosen if each.idle],
        settings.idle_counts,
        rounds=settings.idle_rounds,
        seconds=settings.idle_seconds,
        results=results,
    )


def _attempt(what: str, results: Results, measure: Callable[[], None]) -> None:
    """Measure a part; if it fails, keep the other results."""
    say(what)
    try:
        measure()
    except (ChildFailed, subprocess.SubprocessError) as error:
        results.left_out[what] = str(error)
        say(f"{what}: {error}")


def expected_minutes(contenders: Sequence[Contender], settings: Settings) -> float:
    """How long a run takes: each measurement with its warm-up, and what lies between them."""
    measured = 0
    for workloads in phases(can_pin=CAN_PIN):
        for workload in workloads:
            count = sum(workload.suits(each) for each in contenders)
            measured += count + count // TURNS  # the baseline's turns
    a_round = measured * (WITH_WARM_UP * settings.seconds + BETWEEN)
    a_round += 2 * len(contenders) * START + COMMANDS
    held = sum(each.idle for each in contenders) * len(settings.idle_counts)
    idle_round = held * (WITH_WARM_UP * settings.idle_seconds + HOLDING)
    seconds = settings.rounds * a_round + settings.idle_rounds * idle_round
    return (seconds + len(contenders) * START) / 60


def write(results: Results, folder: Path) -> None:
    """Write the numbers of a run, and the tables of the runs with all Pythons."""
    folder.mkdir(parents=True, exist_ok=True)
    _write(folder / f"results-{results.python}.json", to_json(results))
    write_tables(folder)


def write_tables(folder: Path) -> None:
    """Write RESULTS.md and latency.svg from the numbers in a folder."""
    runs = published(folder)
    current = sources_digest()
    for run in runs:
        if run.about.get("sources") != current:
            say(
                f"results-{run.python}.json is older than the code: measure Python {run.python} too"
            )
    _write(folder / "RESULTS.md", report(runs))
    _write(folder / "latency.svg", picture(runs[0]))


def published(folder: Path) -> list[Results]:
    """The runs whose numbers are in a folder, the oldest Python first."""
    runs = [from_json(path.read_text(encoding="utf-8")) for path in folder.glob("results-*.json")]
    return sorted(runs, key=lambda run: [int(part) for part in run.python.split(".")])


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    say(f"wrote {path}")


def _versions(contenders: Sequence[Contender]) -> dict[str, str]:
    packages = {each.distribution for each in contenders if each.distribution}
    found = {name: version_of(name) for name in [*packages, "msgspec", "uvloop"]}
    return {name: version for name, version in found.items() if version}


def _leave_out(contender: Contender, results: Results) -> bool:
    if missing := contender.missing():
        results.left_out[contender.name] = f"{', '.join(missing)} is not installed"
        say(f"left out: {contender.name} ({results.left_out[contender.name]})")
    return bool(missing)


def _started(contenders: Sequence[Contender], stack: ExitStack, results: Results) -> list[Pair]:
    pairs = []
    for contender in contenders:
        pair = stack.enter_context(Pair(contender))
        try:
            pairs.append(pair.start())
        except ChildFailed as error:
            if contender is BASELINE:
                raise
            results.left_out[contender.name] = str(error)
            say(f"left out: {error}")
    return pairs
