"""One measurement in a process of its own: `-m benchmarks.growing.child TOPIC SIZE SECONDS`."""

from __future__ import annotations

import asyncio
import json
import sys

from benchmarks.growing.topics import topic
from benchmarks.harness.limits import open_files


def main(name: str, size: str, seconds: str) -> None:
    """Measure, and print what came out as JSON."""
    open_files()
    sample = topic(name).load()
    print(json.dumps(asyncio.run(sample(int(size), float(seconds)))))


if __name__ == "__main__":
    main(*sys.argv[1:])
