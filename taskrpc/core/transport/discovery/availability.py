"""Wakes clients that wait for a service; one task watches the registry for all of them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol, TypeAlias

Mark: TypeAlias = tuple[int, object]
"""The number of notifications, and the directory's own mark."""


class Directory(Protocol):
    """The part of a network that knows the processes: the registry, or a hub in memory."""

    def mark(self) -> object:
        """The present state of the directory, for `changed`."""

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return once the directory differs from the mark; look more often if `polls_fast()`."""


class Availability:
    """Notifies waiting clients when services may have become available."""

    def __init__(self, directory: Directory) -> None:
        self._directory = directory
        self._notifications = 0
        self._next: asyncio.Future[None] | None = None
        """Done at the next notification."""
        self._watcher: asyncio.Task[None] | None = None
        """Watches the directory; None while no task waits."""
        self._waiting = 0
        """The number of waiting tasks, and of those that need fast polling."""
        self._fast_polls = 0

    def mark(self) -> Mark:
        """The present state, for `wait`."""
        return self._notifications, self._directory.mark()

    def notify(self) -> None:
        """Wake all waiting clients: something changed that the directory does not show."""
        self._notifications += 1
        if self._next is not None:
            self._next.set_result(None)
            self._next = None

    async def wait(self, mark: Mark, timeout: float | None, *, poll_fast: bool = True) -> bool:
        """Return True once something has changed since the mark, False after `timeout` seconds.

        With `poll_fast=False`, for endless waits, the directory is polled less often.
        """
        if self.mark() != mark:
            return True
        loop = asyncio.get_running_loop()
        if self._watcher is None:
            self._watcher = loop.create_task(self._watch(mark[1]))
        if self._next is None:
            self._next = loop.create_future()
        self._waiting += 1
        self._fast_polls += poll_fast
        try:
            done, _ = await asyncio.wait((self._next,), timeout=timeout)
        finally:
            self._waiting -= 1
            self._fast_polls -= poll_fast
            if not self._waiting:
                self._watcher.cancel()
                self._watcher = None
        return bool(done)

    async def _watch(self, mark: object) -> None:
        while True:
            await self._directory.changed(mark, lambda: self._fast_polls > 0)
            mark = self._directory.mark()
            self.notify()
