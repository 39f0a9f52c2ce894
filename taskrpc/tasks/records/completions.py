"""A task server's store as its exactly-once services see it."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any

from taskrpc.request_ids.ids import Client, Completion, Remembered
from taskrpc.tasks.records.repository import TaskBook
from taskrpc.tasks.records.store import TaskStore


class TaskCompletions:
    """A `CompletionStore` whose completions stand beside the tasks.

    The store belongs to whoever has the services' name: it is touched only once `opened` is called.
    """

    def __init__(self, store: TaskStore, book: TaskBook) -> None:
        self._store = store
        self._book = book
        self._is_open = asyncio.Event()

    def opened(self) -> None:
        """The task server has read the store."""
        self._is_open.set()

    async def recall(self) -> Remembered:
        """Return what is remembered; waits until the task server has read the store."""
        await self._is_open.wait()
        stored = await self._store.load()
        return Remembered(stored.store_id, stored.completions)

    async def complete(
        self, completion: Completion | None, effect: Any, forgotten: Sequence[Client] = ()
    ) -> None:
        """Remember a completion that has no task, and forget clients."""
        assert effect is None, "handlers store their tasks themselves, with the completion"
        await self._book.save(completion=completion, clients=forgotten)
