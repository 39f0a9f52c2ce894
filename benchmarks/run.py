"""Measure taskrpc beside raw asyncio, an ideal RPC and others, on this machine.

    python benchmarks/run.py              # 15 minutes; writes RESULTS.md beside this file
    python benchmarks/run.py --quick      # 1 minute: is everything there, does it work?
    python benchmarks/run.py --only taskrpc "taskrpc, uvloop" --out results

Peers take part if they are installed (`pip install '.[bench]'`; nats-server by the system's own
means). For numbers to quote, leave the machine alone meanwhile.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.contenders import BASELINE, CONTENDERS
from benchmarks.harness.benchmark import QUICK, Settings, run, write


def main() -> int:
    """Measure, and write the results."""
    options = _parser().parse_args()
    names = {BASELINE.name, *(options.only or [each.name for each in CONTENDERS])}
    settings = QUICK if options.quick else Settings()
    if options.rounds:
        settings = replace(settings, rounds=options.rounds)
    if options.no_idle:
        settings = replace(settings, idle_counts=())
    try:
        results = run([each for each in CONTENDERS if each.name in names], settings)
    except KeyboardInterrupt:
        return 130
    write(results, options.out)
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
    home = Path(__file__).parent
    add("--out", type=Path, metavar="FOLDER", default=home, help="(the folder of this file)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
