"""Measures how costs grow with connections, services, tasks and payloads; writes GROWTH.md.

A whole run takes a few minutes and 3 GB of memory; `--quick` stops at small sizes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.growing.curves import Curve
from benchmarks.growing.picture import picture
from benchmarks.growing.report import report, to_json
from benchmarks.growing.topics import TOPICS, Topic
from benchmarks.harness.machine import about
from benchmarks.harness.processes import ROOT

_PATIENCE = 900.0


def main() -> int:
    """Measure, and write the results."""
    options = _parser().parse_args()
    chosen = [topic for topic in TOPICS if topic.name in (options.only or [topic.name])]
    seconds = 0.2 if options.quick else 1.0
    try:
        found = [
            (topic, list(_curves(topic, quick=options.quick, seconds=seconds))) for topic in chosen
        ]
    except KeyboardInterrupt:
        return 130
    facts = {**about(), "quick": options.quick}
    rows = [(topic.title, curves) for topic, curves in found]
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in (
        ("GROWTH.md", report(facts, found)),
        ("growth.json", to_json(facts, found)),
        ("growth.svg", picture("What grows with what", rows)),
    ):
        (options.out / name).write_text(text, encoding="utf-8")
    return 0 if all(curve.is_within for _, curves in found for curve in curves) else 1


def _curves(topic: Topic, *, quick: bool, seconds: float) -> Iterator[Curve]:
    sizes = tuple(size for size in topic.sizes if not quick or size <= topic.quick)
    samples = []
    for size in sizes:
        print(f"{topic.title}: {size:,}", file=sys.stderr, flush=True)
        samples.append(_sample(topic, size, seconds))
    for measure in topic.measures:
        yield Curve(measure, sizes, tuple(sample[measure.name] for sample in samples))


def _sample(topic: Topic, size: int, seconds: float) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as runtime:
        os.chmod(runtime, 0o700)
        env = {
            **os.environ,
            "XDG_RUNTIME_DIR": runtime,
            "ROS_DOMAIN_ID": "0",
            "TASKRPC_INTERFACE_PATH": str(ROOT / "benchmarks" / "interfaces"),
        }
        command = [sys.executable, "-m", "benchmarks.growing.child"]
        done = subprocess.run(
            [*command, topic.name, str(size), str(seconds)],
            cwd=ROOT,
            env=env,
            stdout=subprocess.PIPE,
            timeout=_PATIENCE,
            check=True,
        )
    found: dict[str, float] = json.loads(done.stdout)
    return found


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add = parser.add_argument
    add("--quick", action="store_true", help="small sizes, short measurements")
    names = [topic.name for topic in TOPICS]
    add("--only", nargs="+", choices=names, metavar="TOPIC", help=f"of {', '.join(names)}")
    home = Path(__file__).parent
    add("--out", type=Path, metavar="FOLDER", default=home, help="(the folder of this file)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
