"""`taskrpc graduate`: finds what a program would do differently on a real ROS 2."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from taskrpc.cli.shared.command import Exit, UsageError
from taskrpc.cli.shared.parsing import number
from taskrpc.errors import TaskRpcError


def configure(parser: argparse.ArgumentParser) -> None:
    """Give the parser of `taskrpc graduate` its arguments."""
    what = "A Python file, or a folder with programs and packages"
    parser.add_argument("path", metavar="FILE|FOLDER", help=what)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--json", action="store_true", help="Print a JSON array of the findings")
    what = "Run the file here and with the real ROS 2 of this computer, with these arguments"
    which.add_argument("--run", metavar="ARGS", dest="both", nargs=argparse.REMAINDER, help=what)
    what = "Before --run: seconds after which a program that still runs gets Ctrl-C (default: 10)"
    positive = number("above 0", lambda n: n > 0)
    parser.add_argument("--timeout", metavar="S", type=positive, default=10.0, help=what)
    parser.set_defaults(run=_graduate)


def _graduate(options: argparse.Namespace) -> int:
    from taskrpc.ros.graduation.check import check

    path = Path(options.path)
    if options.both is not None and not path.is_file():
        raise UsageError(f"expected a Python file with --run, got {path}")
    try:
        found = check(path)
    except TaskRpcError as error:
        raise UsageError(str(error)) from None
    if options.json:
        print(json.dumps([{"path": str(path), **one._asdict()} for path, one in found]))
    else:
        for finding in found:
            print(finding)
        if not found:
            print("found nothing that a real ROS 2 would do differently")
    differs = _differs(path, options) if options.both is not None else False
    return Exit.ERROR if found or differs else Exit.DONE


def _differs(path: Path, options: argparse.Namespace) -> bool:
    """Run the program with taskrpc and with ROS 2; print whether and how they differ."""
    from taskrpc.ros.graduation.comparison import differences, real_python

    python = real_python()
    if not python:
        raise UsageError("--run needs a real ROS 2: source its setup.bash first")
    sys.stdout.flush()
    lines = list(differences(python, path, options.both, options.timeout))
    print("\n".join(lines) or "ROS 2 prints the same and ends in the same way")
    return bool(lines)
