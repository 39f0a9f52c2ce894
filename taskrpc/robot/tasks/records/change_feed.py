"""The change feed: a revision number for every change, and watchers that wait for the next one."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from itertools import takewhile
from typing import TypeAlias

ChangeListener: TypeAlias = Callable[[int | None], object]
"""Gets the task that has changed, None for the whole queue; it must be quick and not raise."""


class ChangeFeed:
    """Wakes watchers, and lists the tasks that changed since a revision.

    Args:
        revision: the first revision. It should be higher than the revisions of an earlier server,
            so that a watcher notices the new server.
        capacity: how many changed tasks the feed remembers.
    """

    def __init__(self, revision: int = 1, *, capacity: int = 4096) -> None:
        self.revision = revision
        """Grows by one with each announcement; 0 is older than every revision."""
        self._capacity = capacity
        self._changed_at: dict[int, int] = {}  # task_id -> revision, in the order of change
        self._known_from = revision  # changes up to this revision may have been forgotten
        self._next: asyncio.Future[None] | None = None  # resolved by the next announcement
        self._is_closed = False
        self._listeners: list[ChangeListener] = []

    @property
    def is_closed(self) -> bool:
        """Whether watchers are not allowed to wait any more."""
        return self._is_closed

    def close(self) -> None:
        """Wake all watchers and let no watcher wait any more, because the server ends."""
        self._is_closed = True
        self._wake()

    def add_listener(self, listener: ChangeListener) -> None:
        """Call a function at each change, before any watcher; also after `close`."""
        self._listeners.append(listener)

    def announce(self, task_id: int | None = None) -> None:
        """Wake the watchers: this task has changed, or without `task_id` the whole queue."""
        self.revision += 1
        if task_id is not None:
            self._changed_at.pop(task_id, None)
            self._changed_at[task_id] = self.revision
            if len(self._changed_at) > self._capacity:
                self._known_from = self._changed_at.pop(next(iter(self._changed_at)))
        for listener in self._listeners:
            listener(task_id)
        self._wake()

    def changed_since(self, revision: int) -> list[int] | None:
        """Return the tasks that changed since then, oldest first; None if the feed forgot them."""
        if not self._known_from <= revision <= self.revision:
            return None
        newest_first = takewhile(
            lambda task_id: self._changed_at[task_id] > revision, reversed(self._changed_at)
        )
        return list(newest_first)[::-1]

    async def wait_for_change(self, revision: int, timeout: float, *, task_id: int = 0) -> bool:
        """Wait for a change after `revision`; with `task_id`, for a change of that task.

        Returns False if there was none within `timeout` seconds.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while not (self._is_closed or self._has_changed(revision, task_id)):
                    await self._next_announcement()
        return self._has_changed(revision, task_id)

    def _has_changed(self, revision: int, task_id: int) -> bool:
        if not task_id or revision > self.revision:  # a higher revision is another server's
            return self.revision != revision
        return revision < self._known_from or self._changed_at.get(task_id, 0) > revision

    def _wake(self) -> None:
        if self._next is not None:
            self._next.set_result(None)
            self._next = None

    async def _next_announcement(self) -> None:
        if self._next is None:
            self._next = asyncio.get_running_loop().create_future()
        await asyncio.shield(self._next)
