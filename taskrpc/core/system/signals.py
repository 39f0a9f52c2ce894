"""Signals that end a program: to this one, and from this one to others."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Callable, Iterator

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

_NO_SUCH_PROCESS = 87  # Windows' ERROR_INVALID_PARAMETER: no process has this id


@contextlib.contextmanager
def stop_signals(stop: Callable[[int], object]) -> Iterator[None]:
    """Call `stop(signal number)` at Ctrl-C, SIGTERM and Windows' Ctrl-Break.

    `stop` runs on the main thread, between any two of its steps. Only the main thread can change
    signal handlers: in other threads, this does nothing. Blocks may overlap; the `stop` of each is
    called.
    """
    import signal
    import threading

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if not _stops:
        _before.update({number: signal.signal(number, _stop_all) for number in _stop_signals()})
    _stops.append(stop)
    try:
        yield
    finally:
        _stops.remove(stop)
        if not _stops:
            for number, handler in _before.items():
                signal.signal(number, handler)


_stops: list[Callable[[int], object]] = []
"""The functions of all open `stop_signals` blocks."""


_before: dict[int, Any] = {}
"""The program's own signal handlers, to restore after the last block."""


def _stop_all(number: int, _: object) -> None:
    for stop in tuple(_stops):
        stop(number)


def _stop_signals() -> list[int]:
    import signal

    names = ("SIGINT", "SIGTERM", "SIGBREAK")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def end_process(pid: int, *, at_once: bool = False) -> None:
    """Send a process the signal to end; with `at_once`, kill it.

    Raises ProcessLookupError if there is no such process.
    """
    import signal

    if sys.platform == "win32":
        # On Windows, SIGTERM is TerminateProcess. Only Ctrl-Break would let the process end
        # gracefully, and it can only be sent to groups.
        try:
            os.kill(pid, signal.SIGTERM)
        except OSError as error:
            if error.winerror == _NO_SUCH_PROCESS:
                raise ProcessLookupError(errno.ESRCH, os.strerror(errno.ESRCH)) from None
            raise
    else:
        os.kill(pid, signal.SIGKILL if at_once else signal.SIGTERM)
        # A process stopped by Ctrl-Z handles signals only after it continues.
        os.kill(pid, signal.SIGCONT)
