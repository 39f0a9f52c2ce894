"""Throttled log lines about events that may happen thousands of times a second."""

from __future__ import annotations

import logging

PERIOD = 10.0
"""Seconds between two lines."""


class ThrottledLog:
    """One line in ten seconds; the next line says how many were left out."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._next = float("-inf")
        self._left_out = 0

    def warning(self, now: float, message: str, *args: object) -> None:
        """Log a line, unless the last one is recent; `now` is in seconds on any clock."""
        if now < self._next:
            self._left_out += 1
            return
        self._next = now + PERIOD
        if self._left_out:
            message, args = message + " (and %d times more before)", (*args, self._left_out)
            self._left_out = 0
        self._log.warning(message, *args)


LINES = 100
"""Lines in each period; a flood of connections must not fill the disk with its log."""


class LimitedLog:
    """At most `LINES` lines in ten seconds; further lines are only counted."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._until = float("-inf")
        self._count = 0

    def warning(self, now: float, message: str, *args: object) -> None:
        """Log a line, unless the period has had `LINES`; `now` is in seconds on any clock."""
        if now >= self._until:
            self._log_rest()
            self._until, self._count = now + PERIOD, 0
        self._count += 1
        if self._count <= LINES:
            self._log.warning(message, *args)
        elif self._count == LINES + 1:
            self._log.warning("… more such lines within %g s are only counted", PERIOD)

    def _log_rest(self) -> None:
        if self._count > LINES:
            self._log.warning("%d more such lines were left out", self._count - LINES)
