"""`taskrpc graduate`: what a program would do differently on a real ROS 2."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from taskrpc.cli.command import Exit, UsageError
from taskrpc.errors import TaskRpcError


def configure(parser: argparse.ArgumentParser) -> None:
    """Give the parser of `taskrpc graduate` its arguments."""
    what = "a Python file, or a folder with programs and packages"
    parser.add_argument("path", metavar="FILE|FOLDER", help=what)
    parser.add_argument("--json", action="store_true", help="print a JSON array of the findings")
    parser.set_defaults(run=_graduate)


def _graduate(options: argparse.Namespace) -> int:
    from taskrpc.graduation.check import check

    try:
        found = check(Path(options.path))
    except TaskRpcError as error:
        raise UsageError(str(error)) from None
    if options.json:
        print(json.dumps([{"path": str(path), **one._asdict()} for path, one in found]))
    else:
        for place in found:
            print(place)
        if not found:
            print("nothing found that a real ROS 2 would do differently")
    return Exit.ERROR if found else Exit.DONE
