"""Sleeping until something arrives, without polling and without losing what arrives meanwhile."""

from __future__ import annotations

import sys
import threading
from collections import deque

_SLICE = 0.1 if sys.platform == "win32" else None
"""Seconds of one wait: on Windows Ctrl-C does not reach a wait on a lock before its end."""


class Sleep:
    """Where spinning threads sleep; `end` may be called from any thread and signal handler."""

    def __init__(self) -> None:
        self.state = object()
        """Another object after each `end`: who read it before looking around sees what came."""
        self._sleepers: deque[threading.Lock] = deque()

    @property
    def has_sleepers(self) -> bool:
        """Whether somebody sleeps."""
        return bool(self._sleepers)

    def end(self) -> None:
        """Wake all who sleep, and whoever is about to."""
        self.state = object()
        while self._sleepers:
            try:
                self._sleepers.pop().release()
            except IndexError:  # another thread was quicker
                return

    def until_ended(self, seen: object, seconds: float | None) -> None:
        """Sleep at most so long, unless `end` was called since `state` was `seen`."""
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
        except ValueError:  # it is being released
            return
