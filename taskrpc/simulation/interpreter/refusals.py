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


class Refusals:
    """Refuses these things to all programs.

    Args:
        present: returns the running program.
        tell: is called with each error, which the program may catch.
    """

    def __init__(
        self,
        present: Callable[[], Process | None],
        tell: Callable[[Process, CannotSimulate], object],
    ) -> None:
        self._present = present
        self._tell = tell

    def install(self) -> None:
        """Begin."""

        def hook(event: str, _: tuple[Any, ...]) -> None:
            if (what := _EVENTS.get(event)) is not None:
                self.check(what)

        sys.addaudithook(hook)

    def check(self, what: str) -> None:
        """Raise CannotSimulate for something, if a program runs now."""
        if (process := self._present()) is not None:
            error = _cannot(what, process)
            self._tell(process, error)
            raise error


def _cannot(what: str, process: Process) -> CannotSimulate:
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
