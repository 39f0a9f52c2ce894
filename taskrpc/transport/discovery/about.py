"""What this process is, as its user knows it."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from pathlib import Path

from taskrpc.transport.discovery.entries import Entry


def this_process() -> Entry:
    """An entry that has nothing yet."""
    return Entry(pid=os.getpid(), script=_script(), folder=_folder(), since=time.time())


def _script() -> str:
    """The program as its user knows it: an installed command's name, a script's path."""
    program = Path(sys.argv[0]) if sys.argv and sys.argv[0] else Path("python")
    name = program.name
    if program.suffix == ".py":
        name = str(program)
        with contextlib.suppress(ValueError, OSError):
            name = str(program.resolve().relative_to(Path.cwd()))
    # File names need not be text; what travels must be.
    return name.encode(errors="replace").decode()


def _folder() -> str:
    try:
        return str(Path.cwd()).encode(errors="replace").decode()
    except OSError:  # deleted under our feet
        return "?"
