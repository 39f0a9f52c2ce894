"""Sends a signal again when the main thread has not handled it.

Python only records a signal, and runs its handler between two instructions of the main thread. A
signal just before a blocking wait would be handled after the wait, which may never end.
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

_FIRST_INTERVAL = 0.05
"""Seconds after which a signal is sent again."""
_MAX_INTERVAL = 1.0
"""The longest such interval in seconds: it doubles while the main thread runs native code."""

_reminder: Reminder | None = None


class Reminder:
    """Sends signals again.

    Python writes the number of each signal to a socket; the handler calls `handled`.
    """

    def __init__(self) -> None:
        self.handlers: dict[int, Any] = {}
        """The signals that are sent again, each with its handler while it is installed."""
        self._ours, self._pythons = socket.socketpair()  # Python writes to the second one
        self._ours.setblocking(False)
        self._pythons.setblocking(False)
        self._handled_count = 0
        """How often a handler has run."""
        threading.Thread(target=self._watch, name="taskrpc signals", daemon=True).start()

    def begin(self) -> None:
        """Watch for signals, unless the program has a wakeup file descriptor of its own."""
        before = signal.set_wakeup_fd(self._pythons.fileno(), warn_on_full_buffer=False)
        if before not in (-1, self._pythons.fileno()):
            signal.set_wakeup_fd(before)

    def end(self) -> None:
        """Stop watching."""
        before = signal.set_wakeup_fd(-1)
        if before != self._pythons.fileno():
            signal.set_wakeup_fd(before)

    def handled(self) -> None:
        """Record that the handler has run; called by the handler."""
        self._handled_count += 1
        self._take_numbers()

    def waits(self) -> bool:
        """Whether Python has recorded a signal that no handler reported as handled."""
        return bool(select.select([self._ours], [], [], 0)[0])

    def close(self) -> None:
        """Close the sockets that a child process inherited."""
        self.end()
        self._ours.close()
        self._pythons.close()

    def _watch(self) -> None:
        interval, before = _FIRST_INTERVAL, -1
        while True:
            select.select([self._ours], [], [])
            time.sleep(interval)
            handled = self._handled_count
            arrived = self._take_numbers()
            # Not to the handler of a notebook or debugger: it does not call `handled`.
            numbers = [
                number
                for number, handler in list(self.handlers.items())
                if number in arrived and signal.getsignal(number) is handler
            ]
            is_unhandled = bool(numbers) and handled == before
            interval = min(2 * interval, _MAX_INTERVAL) if is_unhandled else _FIRST_INTERVAL
            before = handled
            for number in numbers:
                if self._handled_count == handled:  # no handler ran in between
                    _send(number)

    def _take_numbers(self) -> bytes:
        """Take the numbers of the signals that have arrived and were not handled."""
        with contextlib.suppress(BlockingIOError):
            return self._ours.recv(4096)
        return b""


def begin(number: int, handler: Any) -> None:
    """Send this signal again while this handler is installed; call it in the main thread."""
    global _reminder
    if _reminder is None:
        _reminder = Reminder()
    _reminder.handlers[number] = handler
    _reminder.begin()


def end() -> None:
    """Send no signal again."""
    if _reminder is not None:
        _reminder.handlers.clear()
        _reminder.end()


def handled() -> None:
    """Record that a signal handler has run; call it in the handler."""
    if _reminder is not None:
        _reminder.handled()


def comes_again() -> bool:
    """Whether the signal whose handler runs now would be sent again if it is postponed."""
    return _reminder is not None and _reminder.waits()


def _send(number: int) -> None:
    if sys.platform == "win32":
        signal.raise_signal(number)  # which interrupts `time.sleep` on Windows
    elif (main := threading.main_thread().ident) is not None:
        signal.pthread_kill(main, number)  # interrupts a system call, too


def _forget() -> None:
    """Forget the signals of the parent process, in a child."""
    global _reminder
    if _reminder is not None:
        _reminder.close()
        _reminder = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
