"""Measures how long `taskrpc lab check --all` takes for a class: 120 submissions of labs 1 and 4.

    python -m benchmarks.grading [--submissions 120] [--jobs N] [LAB ...]

The submissions are the solutions and the typical wrong submissions of `examples/labs`, in turn.
Run it in a checkout, on a machine that does nothing else. The CPU time is that of all processes
which the command has started and waited for.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from taskrpc.course.labs.variants import Variant
from tests.labs.submissions import LECTURERS, solution_of, submission


def write_class(folder: Path, number: int, count: int) -> None:
    """Write the submissions of one lab, each into a folder of its own."""
    solution = solution_of(number)
    wrong = sorted((LECTURERS / f"lab{number}" / "wrong").iterdir())
    for student, source in zip(range(count), itertools.cycle([solution, *wrong])):
        submission(number, source, folder / f"student_{student:03}_{source.name}", Variant())


def measure(number: int, count: int, jobs: list[str]) -> tuple[float, float]:
    """Grade one lab; returns the seconds and the seconds of CPU."""
    with tempfile.TemporaryDirectory() as folder:
        write_class(Path(folder), number, count)
        command = [sys.executable, "-m", "taskrpc", "lab", "check", str(number), *jobs]
        used, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        ended = subprocess.run(
            [*command, "--all", folder, "--csv"], stdout=subprocess.PIPE, text=True, check=False
        )
        seconds, now = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        rows = list(csv.DictReader(ended.stdout.splitlines()))
        full = [row for row in rows if row["points"] == row["max"]]
        right = [row for row in rows if row["student"].endswith("_solution")]
        if len(rows) != count or full != right:
            raise SystemExit(
                f"lab {number}: expected full points for the {len(right)} solutions of {count}"
                f" submissions; {len(full)} of {len(rows)} got them"
            )
        cpu = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
    print(f"lab {number}: {count} submissions, {seconds:.0f} s, {cpu:.0f} s of CPU", flush=True)
    return seconds, cpu


def main() -> None:
    """Grade each lab, and print the sum."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("labs", metavar="LAB", nargs="*", type=int, default=[1, 4])
    parser.add_argument("--submissions", type=int, default=120, help="of all labs together (120)")
    parser.add_argument("--jobs", help="as for taskrpc lab check")
    options = parser.parse_args()
    jobs = ["--jobs", options.jobs] if options.jobs else []
    count = options.submissions // len(options.labs)
    measured = [measure(number, count, jobs) for number in options.labs]
    seconds, cpu = (sum(each) for each in zip(*measured, strict=True))
    print(f"together: {seconds:.0f} s, {cpu:.0f} s of CPU, on {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
