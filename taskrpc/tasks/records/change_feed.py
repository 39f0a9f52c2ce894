"""The notice board: a revision for every change, and watchers that wait for the next one."""

from __future__ import annotations

import asyncio
import contextlib
from itertools import takewhile


class Board:
    """Tells those who wait what has changed since they last looked.

    Args:
        revision: the first one. Those of the server before should be lower, so that a watcher
            notices that it talks to another one.
        capacity: of how many tasks the latest change is remembered.
    """

    def __init__(self, revision: int = 1, *, capacity: int = 4096) -> None:
        self.revision = revision
        """Grows with each announcement; 0 is older than everything."""
        self._capacity = capacity
        self._changed_at: dict[int, int] = {}  # task_id -> revision, in the order of change
        self._known_from = revision  # what changed at this one or before may have been forgotten
        self._next: asyncio.Future[None] | None = None
        self._is_closed = False

    @property
    def is_closed(self) -> bool:
        """Whether nobody may wait any more."""
        return self._is_closed

    def close(self) -> None:
        """Let all who wait go, and let nobody wait any more: the server ends."""
        self._is_closed = True
        self._wake()

    def announce(self, task_id: int | None = None) -> None:
        """Wake the watchers: this task has changed, or the queue as a whole."""
        self.revision += 1
        if task_id is not None:
            self._changed_at.pop(task_id, None)
            self._changed_at[task_id] = self.revision
            if len(self._changed_at) > self._capacity:
                self._known_from = self._changed_at.pop(next(iter(self._changed_at)))
        self._wake()

    def changed_since(self, revision: int) -> list[int] | None:
        """The tasks that changed since, oldest change first; None if that is no longer known."""
        if not self._known_from <= revision <= self.revision:
            return None
        newest_first = takewhile(
            lambda task_id: self._changed_at[task_id] > revision, reversed(self._changed_at)
        )
        return list(newest_first)[::-1]

    async def wait_for_change(self, revision: int, timeout: float, *, task_id: int = 0) -> bool:
        """Wait until something is newer than `revision`; with `task_id`, something about it.

        Returns False when `timeout` seconds have passed without.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while not (self._is_closed or self._is_news(revision, task_id)):
                    await self._next_announcement()
        return self._is_news(revision, task_id)

    def _is_news(self, revision: int, task_id: int) -> bool:
        if not task_id or revision > self.revision:  # beyond ours: it is another server's revision
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
