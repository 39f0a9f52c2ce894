"""What cannot be simulated is refused, with the line of the program that asked for it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from taskrpc.errors import TaskRpcError
from taskrpc.simulation.interpreter.programs import Process

_EVENTS: Final = {
    "socket.__new__": "a socket",
    "subprocess.Popen": "a subprocess",
    "os.system": "a subprocess",
    "os.exec": "another program",
    "os.kill": "a signal",
    "os.killpg": "a signal",
    "signal.pthread_kill": "a signal",
    "builtins.input": "the keyboard",
    "os.fork": "a copy of its process",
    "os.forkpty": "a copy of its process",
    "os.posix_spawn": "a subprocess",
    "os.spawn": "a subprocess",
}
"""The audit events of Python, and what a program wants there."""


class CannotSimulate(TaskRpcError):
    """A program uses something outside of the simulated world."""


def refuse(is_program: Callable[[], bool], cannot: Callable[[str], Exception]) -> None:
    """Refuse these things to all programs from now on.

    `is_program`: whether a program runs now; `cannot` returns the error.
    """

    def hook(event: str, _: tuple[Any, ...]) -> None:
        if (what := _EVENTS.get(event)) is not None and is_program():
            raise cannot(what)

    sys.addaudithook(hook)


def cannot_simulate(what: str, process: Process) -> CannotSimulate:
    """Return the error for something that a program uses."""
    folder, frame, where = str(process.folder), sys._getframe(1), process.name
    while frame is not None:
        if frame.f_code.co_filename.startswith(folder):
            where = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
            break
        frame = frame.f_back  # type: ignore[assignment]
    return CannotSimulate(
        f"{where} of {process.name} uses {what}, which cannot be simulated; leave it out in the"
        " simulated program, for example by an argument of scenario.program"
    )
