"""Measures `taskrpc simulate`: what it finds, what it finds by mistake, and how fast it is.

    python -m benchmarks.simulate [--seconds 60] [--runs 10000] [--json FILE]

- Each planted mistake of `tests/simulation/systems/mistakes`: found within so many seconds?
- Each correct system of `tests/simulation/systems/correct`: so many runs, and no false alarm?
- The same seeds in two processes with another order of Python's own hashes: the same hashes?
- Three small programs: how many runs a second of one core?

Run it in a checkout, on a machine that does nothing else; with the default values it takes an hour.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import msgspec

from taskrpc.simulation.search.protocol import Search
from taskrpc.simulation.search.search import WorkerProcess, search

SYSTEMS = Path(__file__).resolve().parents[1] / "tests" / "simulation" / "systems"

_SERVER = """\
import asyncio, srvgen, taskrpc
Trigger = srvgen.load("std_srvs/srv/Trigger")
async def main():
    async with taskrpc.Node("robot") as node:
        def pick(request, response):
            print("picked")
            response.success = True
            return response
        node.create_service(Trigger, "pick", pick)
        await node.spin()
asyncio.run(main())
"""
_CLIENT = """\
import asyncio, srvgen, taskrpc
Trigger = srvgen.load("std_srvs/srv/Trigger")
async def main():
    async with taskrpc.Node("NAME") as node:
        client = node.create_client(Trigger, "pick", timeout=10.0)
        await client.wait_for_service(None)
        for number in range(5):
            try:
                await client.call(Trigger.Request(), retry=taskrpc.RetryPolicy())
                print("ordered", number)
            except taskrpc.TaskRpcError as error:
                print("failed", number, error)
asyncio.run(main())
"""
_SCENARIO = """\
from taskrpc.simulation import Scenario
scenario = Scenario()
scenario.program("robot", "robot.py")
scenario.program("ada", "ada.py")
scenario.program("ben", "ben.py")
scenario.faults(lose_requests=0.02, lose_responses=0.05, delay=(0.0, 0.2))
"""


class Mistake(msgspec.Struct, frozen=True):
    """The search for one planted mistake."""

    name: str
    found: bool
    runs: int
    seconds: float
    faults: list[str]
    kind: str


class Correct(msgspec.Struct, frozen=True):
    """The runs of one correct system."""

    name: str
    runs: int
    alarm: str


class Figures(msgspec.Struct, frozen=True):
    """All figures."""

    mistakes: list[Mistake]
    correct: list[Correct]
    same_hashes: bool
    runs_a_second: float
    """Of one core, for three small programs."""


def scenarios(kind: str) -> list[Path]:
    """Return the scenarios of `mistakes` or `correct`."""
    return sorted(SYSTEMS.joinpath(kind).glob("*/*.sim.py"))


def find(file: Path, seconds: float) -> Mistake:
    """Search one mistake."""
    found = search(file, seconds=seconds)
    failure = found.failure
    faults, kind = ([], "") if failure is None else (failure.faults, failure.kind)
    name = file.parent.name
    taken = round(found.seconds, 1)
    return Mistake(name, failure is not None, found.coverage.runs, taken, faults, kind)


def try_correct(file: Path, runs: int) -> Correct:
    """Run a correct system."""
    found = search(file, runs=runs)
    alarm = "" if found.failure is None else f"seed {found.failure.seed}: {found.failure.kind}"
    return Correct(file.parent.name, found.coverage.runs, alarm)


def small(folder: Path) -> Path:
    """Write three small programs and their scenario; returns its file."""
    (folder / "robot.py").write_text(_SERVER)
    for name in "ada", "ben":
        (folder / f"{name}.py").write_text(_CLIENT.replace("NAME", name))
    file = folder / "small.sim.py"
    file.write_text(_SCENARIO)
    return file


def hashes(file: Path, seeds: list[int], hash_seed: str) -> list[tuple[int, int]]:
    """Return the courses of some seeds in a new process."""
    worker = WorkerProcess(hash_seed)
    try:
        worker.load(file)
        answer = worker.ask(Search(seeds))
        shapes: list[tuple[int, int]] = answer.shapes
        return shapes
    finally:
        worker.close()


def speed(file: Path, runs: int) -> float:
    """Return the runs a second of one core."""
    worker = WorkerProcess()
    worker.load(file)
    worker.ask(Search([0]))  # imports
    answer = worker.ask(Search(list(range(1, 1 + runs))))
    worker.close()
    return runs / float(answer.cpu_seconds)


def main() -> int:
    """Measure everything, print it, and return 1 if a promise is broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.simulate", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = small(Path(folder))
        rate = speed(file, 500)
        print(f"three small programs: {rate:.0f} runs a second of one core")
        seeds = list(range(200))
        same = hashes(file, seeds, "1") == hashes(file, seeds, "2")
        print(f"200 seeds in two processes: {'the same' if same else 'DIFFERENT'} courses")
    mistakes, correct = [], []
    for each in scenarios("mistakes"):
        mistakes.append(one := find(each, options.seconds))
        words = f"{one.kind}; {', '.join(one.faults) or 'no fault'}" if one.found else "NOT FOUND"
        print(f"{one.name:<26} {one.runs:>6} runs {one.seconds:>6.1f} s  {words}", flush=True)
    for each in scenarios("correct"):
        correct.append(right := try_correct(each, options.runs))
        print(f"{right.name:<26} {right.runs:>6} runs  {right.alarm or 'no alarm'}", flush=True)
    found = sum(each.found for each in mistakes)
    print(f"{found} of {len(mistakes)} mistakes found")
    if options.json:
        options.json.write_bytes(msgspec.json.encode(Figures(mistakes, correct, same, rate)))
    return 0 if same and not any(each.alarm for each in correct) else 1


if __name__ == "__main__":
    sys.exit(main())
