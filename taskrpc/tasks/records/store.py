"""What must survive the server: the seam to a disk, and its twin in memory."""

from __future__ import annotations

import os
from collections.abc import Awaitable, Sequence
from typing import Protocol

import msgspec

from taskrpc.exactly_once.memory import KeptCompletions
from taskrpc.request_ids.ids import Client, Completion
from taskrpc.tasks.model import Task


class Stored(msgspec.Struct, frozen=True):
    """What a store remembers."""

    tasks: tuple[Task, ...]
    """Every task, by number."""
    next_id: int
    """The number of the next task: higher than any that was ever given, also to a forgotten one."""
    store_id: bytes
    """16 bytes, drawn at random when the store was made, and anew when it was cleared."""
    paused: bool = False
    """Whether somebody halted the queue and nobody let it go on."""
    completions: tuple[Completion, ...] = ()
    """The requests that are done, and may be answered once more."""


class TaskStore(Protocol):
    """Keeps tasks for the next server. Calls take effect in the order in which they are made.

    It opens itself when it is first asked for something.
    """

    async def load(self) -> Stored:
        """Return everything that is remembered.

        Raises:
            StoreError: there is something that cannot be read, or another server uses it.
        """

    def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[Client] = (),
    ) -> Awaitable[None]:
        """Remember these tasks as they are now and forget those numbers; all of it or nothing.

        May be `async`. Whoever stops waiting does not stop it.

        With them it forgets all completions of `clients` and remembers `completion`; what the same
        client has completed below `completion.first_incomplete` is forgotten too.

        When it returns, all this survives the end of this process, and of the machine if the
        store is one on disk.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: only the next server will know whether it was.
        """

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue stands still; when it returns, this survives as tasks do.

        Raises:
            StoreError: nothing was changed.
        """

    async def clear(self) -> None:
        """Forget everything and begin again with number 1, as another store with another id.

        Raises:
            StoreError: nothing was changed.
        """

    async def close(self) -> None:
        """Let others use what this store used; a second close does nothing."""


class MemoryStore:
    """A store that lasts as long as the object itself."""

    def __init__(self) -> None:
        self._tasks: dict[int, Task] = {}
        self._next_id = 1
        self._paused = False
        self._store_id = os.urandom(16)
        self._completions = KeptCompletions()

    async def load(self) -> Stored:
        """Return everything that is remembered."""
        tasks = tuple(self._tasks[number] for number in sorted(self._tasks))
        completions = self._completions.all()
        return Stored(tasks, self._next_id, self._store_id, self._paused, completions)

    async def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[Client] = (),
    ) -> None:
        """Remember these tasks as they are now and forget those numbers; see `TaskStore.apply`."""
        for task in saved:
            self._tasks[task.task_id] = task
            self._next_id = max(self._next_id, task.task_id + 1)
        for number in forgotten:
            self._tasks.pop(number, None)
        self._completions.keep(completion, clients)

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue stands still."""
        self._paused = paused

    async def clear(self) -> None:
        """Forget everything and begin again with number 1, as another store with another id."""
        self._tasks.clear()
        self._next_id = 1
        self._paused = False
        self._store_id = os.urandom(16)
        self._completions = KeptCompletions()

    async def close(self) -> None:
        """Keep everything: the same object can be opened again."""
