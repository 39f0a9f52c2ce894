"""Log lines about what may happen thousands of times a second: at most one in ten seconds."""

from __future__ import annotations

import logging

PERIOD = 10.0
"""Seconds between two lines."""


class SeldomLog:
    """One kind of trouble; lines that are left out are counted in the next one."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._next = float("-inf")
        self._left_out = 0

    def warning(self, now: float, message: str, *args: object) -> None:
        """Log a line, unless the last one is not long ago; `now` is any clock's."""
        if now < self._next:
            self._left_out += 1
            return
        self._next = now + PERIOD
        if self._left_out:
            message, args = message + " (and %d times more before)", (*args, self._left_out)
            self._left_out = 0
        self._log.warning(message, *args)
