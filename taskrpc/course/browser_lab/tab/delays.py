"""Notices that the tab got its turn late, because the machine is busy or a program blocks it."""

from __future__ import annotations

import asyncio

PAUSE = 0.1
"""Seconds between two measurements."""
LONG = 0.5
"""From this delay in seconds on, a check may have failed because of the time limits."""


class Delays:
    """Remembers the longest delay until `were_long` is called."""

    def __init__(self) -> None:
        self._longest = 0.0

    async def watch(self) -> None:
        """Measure until the task is cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + PAUSE
            await asyncio.sleep(PAUSE)
            self.add(loop.time() - due)

    def add(self, seconds: float) -> None:
        """Take a delay into account."""
        self._longest = max(self._longest, seconds)

    def were_long(self) -> bool:
        """Return whether there was a long delay since the last question."""
        longest, self._longest = self._longest, 0.0
        return longest >= LONG
