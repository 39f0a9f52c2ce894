"""What other threads hand over to the event loop, and what they may not overtake meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class Handing:
    """The part of an endpoint that other threads hand their work to, in order."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.behind: list[None] = []
        """One for each thing that was handed over and is not done yet."""

    def hand_over(self, action: Callable[[], object]) -> None:
        """Have the loop do something that another thread wants, which nothing shall overtake."""
        self.behind.append(None)
        self.loop.call_soon_threadsafe(self._take_over, action)

    def _take_over(self, action: Callable[[], object]) -> None:
        try:
            action()
        finally:
            self.behind.pop()
