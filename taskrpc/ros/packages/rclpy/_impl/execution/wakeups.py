"""Sleep until a wakeup, without polling and without losing a wakeup that comes in between."""

from __future__ import annotations

import sys
import threading
from collections import deque

_SLICE = 0.1 if sys.platform == "win32" else None
"""Seconds of one wait: on Windows, Ctrl-C cannot interrupt a wait on a lock."""


class Sleep:
    """Lets threads sleep; `end` wakes them from any thread and from signal handlers."""

    def __init__(self) -> None:
        self.state = object()
        """Replaced by `end`. Read it before you check for work; pass it to `until_ended`."""
        self._sleepers: deque[threading.Lock] = deque()

    @property
    def has_sleepers(self) -> bool:
        """Whether a thread sleeps."""
        return bool(self._sleepers)

    def end(self) -> None:
        """Wake all threads that sleep or are about to sleep."""
        self.state = object()
        while self._sleepers:
            try:
                self._sleepers.pop().release()
            except IndexError:  # another thread woke the last one
                return

    def until_ended(self, seen: object, seconds: float | None) -> None:
        """Sleep for at most `seconds`; not at all if `end` was called since `state` was `seen`."""
        lock = threading.Lock()
        lock.acquire()
        self._sleepers.append(lock)
        if self.state is not seen:
            self._leave(lock)
        elif _SLICE is None and seconds is None:
            lock.acquire()
        else:
            self._doze(lock, seconds)

    def _doze(self, lock: threading.Lock, seconds: float | None) -> None:
        left = float("inf") if seconds is None else seconds
        while left > 0:
            part = min(left, threading.TIMEOUT_MAX if _SLICE is None else _SLICE)
            if lock.acquire(timeout=part):
                return
            left -= part
        self._leave(lock)

    def _leave(self, lock: threading.Lock) -> None:
        try:
            self._sleepers.remove(lock)
        except ValueError:  # `end` is releasing it
            return
