"""The ordered hand-off from the threads of a middleware to the event loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from typing import Any


class Handoff:
    """Passes calls from threads to the event loop, in order.

    Calls that arrive together wake the loop once. A `call_soon_threadsafe` for each of them would
    write a byte to a socket each time.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.turn = 0
        """Counts the turns of the loop that handled calls."""
        self._loop = loop
        self._waiting: deque[tuple[Callable[..., object], tuple[Any, ...]]] = deque()
        self._is_planned = False
        self._is_closed = False

    def put(self, action: Callable[..., object], *arguments: Any) -> None:
        """Call an action on the event loop soon; any thread may call this."""
        self._waiting.append((action, arguments))
        if not self._is_planned:
            self._is_planned = True
            with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
                self._loop.call_soon_threadsafe(self.drain)

    def drain(self) -> None:
        """Make the calls that wait now; later ones plan another turn."""
        self._is_planned = False  # before the loop below: a later `put` must wake the loop again
        self.turn += 1
        for _ in range(len(self._waiting)):
            if self._is_closed:
                return
            action, arguments = self._waiting.popleft()
            try:
                action(*arguments)
            except Exception as error:  # the other calls must be made all the same
                context = {"message": "a callback of a middleware failed", "exception": error}
                self._loop.call_exception_handler(context)

    def close(self) -> None:
        """Drop all calls from now on."""
        self._is_closed = True
        self._waiting.clear()
