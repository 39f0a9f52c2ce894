"""Measure taskrpc beside raw asyncio, an ideal RPC and others, on this machine.

    python benchmarks/run.py              # prints first how many minutes it takes
    python benchmarks/run.py --quick      # one short round: is everything there, does it work?
    python benchmarks/run.py --only taskrpc "taskrpc, uvloop" --out results
    python benchmarks/run.py --tables     # writes the tables again, and measures nothing

A run writes `results-3.12.json` for its Python 3.12 beside this file, and then RESULTS.md from the
files of all Pythons. Peers take part if they are installed (`pip install '.[bench]'`; nats-server
by the system's own means). For numbers to quote, leave the machine alone meanwhile.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.contenders import BASELINE, CONTENDERS
from benchmarks.harness.benchmark import QUICK, Settings, run, say, write, write_tables

HOME = Path(__file__).parent
QUICK_OUT = HOME.parent / "build" / "bench"
"""Where a quick run writes: it must not replace the published figures."""


def main() -> int:
    """Measure, and write the results."""
    options = _parser().parse_args()
    folder = options.out or (QUICK_OUT if options.quick else HOME)
    if options.tables:
        write_tables(folder)
        return 0
    names = {BASELINE.name, *(options.only or [each.name for each in CONTENDERS])}
    settings = QUICK if options.quick else Settings()
    if options.rounds:
        settings = replace(settings, rounds=options.rounds)
    if options.no_idle:
        settings = replace(settings, idle_counts=())
    began = time.monotonic()
    try:
        results = run([each for each in CONTENDERS if each.name in names], settings)
    except KeyboardInterrupt:
        return 130
    say(f"took {(time.monotonic() - began) / 60:.1f} min")
    write(results, folder)
    return 0


def _parser() -> argparse.ArgumentParser:
    summary = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(description=summary)
    add = parser.add_argument
    add("--quick", action="store_true", help="one short round of everything")
    names = ", ".join(f'"{each.name}"' for each in CONTENDERS)
    everybody = [each.name for each in CONTENDERS]
    what = f"contenders beside the baseline: {names}"
    add("--only", nargs="+", metavar="NAME", choices=everybody, help=what)
    add("--rounds", type=int, metavar="N", help=f"({Settings.rounds})")
    add("--no-idle", action="store_true", help="without the servers full of idle connections")
    add("--tables", action="store_true", help="write the tables again from the numbers")
    add("--out", type=Path, metavar="FOLDER", help="(the folder of this file; quick: build/bench)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
