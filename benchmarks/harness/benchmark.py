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
from benchmarks.harness.jsonfile import to_json
from benchmarks.harness.machine import Others, about
from benchmarks.harness.picture import picture
from benchmarks.harness.processes import CAN_PIN, ChildFailed, Pair
from benchmarks.harness.report import report
from benchmarks.harness.results import Results
from benchmarks.harness.rounds import Field, run_rounds
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


def say(text: str) -> None:
    """Print the progress."""
    print(text, file=sys.stderr, flush=True)


def run(contenders: Sequence[Contender], settings: Settings) -> Results:
    """Measure these contenders, of which the baseline must be one."""
    others = Others()
    results = Results({**about(), **asdict(settings)}, _versions(contenders))
    chosen = [each for each in contenders if not _leave_out(each, results)]
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


def write(results: Results, folder: Path) -> None:
    """Write RESULTS.md, results.json and latency.svg."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {
        "RESULTS.md": report(results),
        "results.json": to_json(results),
        "latency.svg": picture(results),
    }
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
        say(f"wrote {folder / name}")


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
