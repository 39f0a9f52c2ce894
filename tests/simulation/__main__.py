"""Repeat one simulation: `python -m tests.simulation --seed N [--verbose]`."""

from __future__ import annotations

import argparse
import sys

from tests.faults.harness import Counts
from tests.simulation.ledger import PROMISES
from tests.simulation.world import simulate


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1, help="number of seeds from there on (1)")
    parser.add_argument("--verbose", action="store_true", help="print every event")
    options = parser.parse_args()
    counts, failed = Counts(), False
    for seed in range(options.seed, options.seed + options.count):
        own = Counts()
        digest = simulate(seed, own, print if options.verbose else None)
        counts.update(own)
        broken = own.broken(*PROMISES)
        if broken or options.count == 1:
            print(f"seed {seed}: {digest} {broken or 'all promises kept'}")
        failed = failed or bool(broken)
    print(counts)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
