"""Watches that something happens often enough: messages, or declarations of liveliness."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class SilenceWatch:
    """Reports on the event loop when nothing has happened for a period.

    It begins with the first call of `happened`. With `repeats`, it reports once for each further
    period of silence; otherwise once until something happens.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        period: float,
        silent: Callable[[], object],
        *,
        repeats: bool,
        resumed: Callable[[], object] | None = None,
    ) -> None:
        self._loop = loop
        self._period = period
        self._silent = silent
        self._resumed = resumed
        self._repeats = repeats
        self._last = self._reported = 0.0
        """When something happened, and the end of the last period of silence."""
        self._is_running = self._is_closed = False
        self._timer: asyncio.TimerHandle | None = None

    def happened(self) -> None:
        """Begin the period anew; from any thread."""
        self._last = self._loop.time()
        if not self._is_running:
            self._is_running = True
            self._loop.call_soon_threadsafe(self._begin)

    def close(self) -> None:
        """Stop watching; from any thread."""
        self._is_closed = True  # a timer that is set ends at its time and does nothing

    def _begin(self) -> None:
        if self._resumed is not None and not self._is_closed:
            self._resumed()
        self._check()

    def _check(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._is_closed:
            return
        if self._left() <= 0 and not self._goes_on():
            return
        self._timer = self._loop.call_later(max(self._left(), 0.0), self._check)

    def _left(self) -> float:
        return max(self._last, self._reported) + self._period - self._loop.time()

    def _goes_on(self) -> bool:
        """Report a period of silence; return whether to wait for the next one."""
        if self._repeats:
            self._reported = max(self._last, self._reported) + self._period
            self._silent()
            return True
        self._is_running = False  # from now on, `happened` begins anew
        if self._left() > 0:  # it was called just before that
            self._is_running = True
            return True
        self._silent()
        return False
