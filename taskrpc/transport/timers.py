"""The deadline wheel on an event loop: one timer for all calls of an endpoint."""

from __future__ import annotations

import asyncio
from typing import Protocol

from taskrpc.deadline import DeadlineWheel


class Expiring(Protocol):
    """What can be given a deadline."""

    def expired(self) -> None:
        """The deadline has passed."""


class Deadlines:
    """Calls `expired()` on items whose deadline passes: never early, at most a tick late."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._wheel: DeadlineWheel[Expiring] = DeadlineWheel()
        self._timer: asyncio.TimerHandle | None = None

    def add(self, deadline: float, item: Expiring) -> int:
        """Watch an item; returns the slot that `discard` wants."""
        slot = self._wheel.add(deadline, item)
        # The timer may stand later than the wheel's tick for this deadline, never earlier.
        if self._timer is None or deadline < self._timer.when():
            self._arm()
        return slot

    def discard(self, slot: int, item: Expiring) -> None:
        """Stop watching an item."""
        self._wheel.discard(slot, item)

    def close(self) -> None:
        """Stop the timer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _arm(self) -> None:
        self.close()
        due = self._wheel.next_due()
        if due is not None:
            self._timer = self._loop.call_at(due, self._turn)

    def _turn(self) -> None:
        self._timer = None
        for item in self._wheel.expire(self._loop.time()):
            item.expired()
        if self._timer is None:
            self._arm()
