"""How the grader starts its Python processes: without the user's settings, and with `speed`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from taskrpc.course.labs.sandbox import speed

_CODE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv.pop(1));"
    "from taskrpc.course.labs.sandbox import boot; boot.main()"
)


SIMULATED = "simulated.process"
"""The module that simulates a program."""


def command(module: str, request: str) -> list[str]:
    """Return the command line of a process that calls `main(request)` of a module here.

    It sees the packages of this process, not those in the working directory or in PYTHONPATH.
    """
    paths = [each for each in sys.path if Path(each).is_absolute() and Path(each).exists()]
    # A simulation reads PYTHONHASHSEED, without which sets have another order in each process.
    alone = ["-P", "-s"] if module == SIMULATED else ["-I"]
    return [sys.executable, *alone, "-X", "utf8", "-c", _CODE, json.dumps(paths), module, request]


def main() -> None:
    """Replace the clocks before anything keeps them, then call the module's `main`.

    A simulation has clocks of its own.
    """
    module, request = sys.argv[1:]
    if module != SIMULATED:
        speed.install()
    from importlib import import_module

    run: Callable[[str], int] = import_module(f"taskrpc.course.labs.sandbox.{module}").main
    sys.exit(run(request))
