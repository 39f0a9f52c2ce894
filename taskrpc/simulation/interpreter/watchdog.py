"""Ends a program that never waits: `while not done: pass` would stop the simulation for ever."""

from __future__ import annotations

import _thread
import ctypes
import time
from collections.abc import Callable
from typing import Final

LIMIT: Final = 5.0
"""Seconds of processor time that a program may run without waiting for anything."""

# The real functions: `prepare` replaces them for the programs.
_start, _sleep, _ident = _thread.start_new_thread, time.sleep, _thread.get_ident
_worked = time.process_time


class NeverWaits(BaseException):
    """A program runs for ever without waiting; not an Exception, which a program may catch."""


def watch(steps: Callable[[], int | None]) -> None:
    """Watch the thread that calls this from now on.

    `steps` returns how often the stacks have run until they waited, None while nothing runs.
    """
    main = _ident()

    def run() -> None:
        last, since = None, _worked()
        while True:
            _sleep(1.0)
            if (present := steps()) is None or present != last:
                last, since = present, _worked()
            elif _worked() - since >= LIMIT:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(
                    ctypes.c_ulong(main), ctypes.py_object(NeverWaits)
                )

    _start(run, ())
