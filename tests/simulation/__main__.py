"""Play seeds again, and tell what happens: `python -m tests.simulation --seed 7 --verbose`."""

from __future__ import annotations

import argparse
import logging

from taskrpc.testing import VirtualTimeLoop
from tests.faults.harness import Counts
from tests.simulation.world import simulate

BROKEN = ("lost", "doubled", "wrong number", "run after all", "driven twice", "late")


def main():
    parser = argparse.ArgumentParser(description="Play one simulation again.")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--verbose", action="store_true", help="tell every event")
    options = parser.parse_args()
    logging.basicConfig(level=logging.DEBUG if options.verbose else logging.CRITICAL)
    counts = Counts()
    simulate(options.seed, counts, VirtualTimeLoop, print if options.verbose else lambda _: None)
    print(counts)
    return 1 if counts.broken(*BROKEN) else 0


if __name__ == "__main__":
    raise SystemExit(main())
