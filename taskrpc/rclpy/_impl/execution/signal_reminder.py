"""Sends a signal once more that the main thread has not heeded.

Python only notes a signal, and runs its handler between two steps of the main thread. One that
comes just before a wait begins would be heeded after the wait, be that never.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import sys
import threading
import time
from typing import Any

_MOMENT = 0.05
"""Seconds after which a signal is sent once more."""
_LONGEST = 1.0
"""It is sent ever more rarely: the main thread may be at work outside of Python."""

_reminder: Reminder | None = None


class Reminder:
    """Is told by Python of each signal, and by its handler that it was heeded."""

    def __init__(self) -> None:
        self.handlers: dict[int, Any] = {}
        """The signals that are sent once more, and what handles them: as long as it does."""
        self._ours, self._pythons = socket.socketpair()
        self._ours.setblocking(False)
        self._pythons.setblocking(False)
        self._heeded = 0
        threading.Thread(target=self._watch, name="taskrpc signals", daemon=True).start()

    def begin(self) -> None:
        """Watch, unless the program itself has a descriptor that Python tells of signals."""
        before = signal.set_wakeup_fd(self._pythons.fileno(), warn_on_full_buffer=False)
        if before not in (-1, self._pythons.fileno()):
            signal.set_wakeup_fd(before)

    def end(self) -> None:
        """Watch no more."""
        before = signal.set_wakeup_fd(-1)
        if before != self._pythons.fileno():
            signal.set_wakeup_fd(before)

    def heeded(self) -> None:
        """Note that the handler has run, from it."""
        self._heeded += 1
        self._told()

    def waits(self) -> bool:
        """Whether a signal is noted that would be sent once more."""
        return bool(select.select([self._ours], [], [], 0)[0])

    def close(self) -> None:
        """Let go of what a child has of its parent's."""
        self.end()
        self._ours.close()
        self._pythons.close()

    def _watch(self) -> None:
        moment, before = _MOMENT, -1
        while True:
            select.select([self._ours], [], [])
            time.sleep(moment)
            heeded = self._heeded
            told = self._told()
            # Not to the handler of a notebook or a debugger: that has had it, and does not say so.
            numbers = [
                number
                for number, handler in list(self.handlers.items())
                if number in told and signal.getsignal(number) is handler
            ]
            moment = min(2 * moment, _LONGEST) if numbers and heeded == before else _MOMENT
            before = heeded
            for number in numbers:
                if self._heeded == heeded:  # not while this looked
                    _send(number)

    def _told(self) -> bytes:
        """The numbers of the signals that came and were not heeded."""
        with contextlib.suppress(BlockingIOError):
            return self._ours.recv(4096)
        return b""


def begin(number: int, handler: Any) -> None:
    """Have this signal sent once more, too, while this handles it; from the main thread."""
    global _reminder
    if _reminder is None:
        _reminder = Reminder()
    _reminder.handlers[number] = handler
    _reminder.begin()


def end() -> None:
    """Have none sent once more."""
    if _reminder is not None:
        _reminder.handlers.clear()
        _reminder.end()


def heeded() -> None:
    """Note, from a signal handler, that it has run."""
    if _reminder is not None:
        _reminder.heeded()


def comes_again() -> bool:
    """Whether the signal whose handler runs would be sent once more if it is not heeded."""
    return _reminder is not None and _reminder.waits()


def _send(number: int) -> None:
    if sys.platform == "win32":
        signal.raise_signal(number)  # which ends `time.sleep` there
    elif (main := threading.main_thread().ident) is not None:
        signal.pthread_kill(main, number)  # ends its waiting, too


def _forget() -> None:
    """A child's signals are none of its parent's."""
    global _reminder
    if _reminder is not None:
        _reminder.close()
        _reminder = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
