"""The store of the task server: the interface to a disk, and a store in memory."""

from __future__ import annotations

import sys
from collections.abc import Awaitable, Sequence
from typing import Protocol

import msgspec

from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records.history import DEFAULT, History
from taskrpc.spi import ClientKey, Completion, CompletionIndex, present_chance


class Stored(msgspec.Struct, frozen=True):
    """Everything that a store remembers."""

    tasks: tuple[Task, ...]
    """Every task, sorted by id."""
    next_id: int
    """The id of the next task: higher than every id that was given, forgotten tasks included."""
    store_id: bytes
    """16 random bytes, drawn when the store was made and again whenever it was cleared."""
    paused: bool = False
    """Whether the queue is paused."""
    completions: tuple[Completion, ...] = ()
    """The completed requests: the server repeats their responses when clients retry them."""


class TaskStore(Protocol):
    """Keeps tasks for the next server. Calls take effect in the order in which they are made.

    A store opens itself at its first call.
    """

    @property
    def history(self) -> History:
        """Which ended tasks are kept. The store archives forgotten tasks that belong to it."""

    async def load(self) -> Stored:
        """Return everything that the store remembers.

        Raises:
            StoreError: the store cannot be read, or another server uses it.
        """

    def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
    ) -> Awaitable[None]:
        """Remember the tasks `saved` and forget the task ids `forgotten`: all of it or nothing.

        May be `async`. A caller that stops waiting does not stop it.

        In the same step it forgets all completions of `clients` and remembers `completion`. It
        also forgets what the client of `completion` completed below `completion.first_incomplete`.

        When it is done, all this survives the end of this process; a store on disk also survives
        a crash of the machine.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: it may have been changed or not; the next server will know.
        """

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue is paused; when it returns, this survives as tasks do.

        Raises:
            StoreError: nothing was changed.
        """

    async def clear(self) -> None:
        """Forget everything and begin again with task 1, as another store with another id.

        Raises:
            StoreError: nothing was changed.
        """

    async def close(self) -> None:
        """Release what the store uses; a second close does nothing."""


class MemoryStore:
    """A store in memory: it lasts as long as the object itself.

    Args:
        history: which ended tasks are kept; the server has all of them in memory.
    """

    def __init__(self, *, history: History = DEFAULT) -> None:
        self.history = msgspec.structs.replace(history, recent=sys.maxsize)
        """Which ended tasks are kept."""
        self._tasks: dict[int, Task] = {}
        self._next_id = 1
        self._paused = False
        self._store_id = present_chance().randbytes(16)
        self._completions = CompletionIndex()

    async def load(self) -> Stored:
        """Return everything that the store remembers."""
        tasks = tuple(self._tasks[task_id] for task_id in sorted(self._tasks))
        completions = self._completions.all()
        return Stored(tasks, self._next_id, self._store_id, self._paused, completions)

    async def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
    ) -> None:
        """Remember and forget tasks and completions; see `TaskStore.apply`."""
        for task in saved:
            self._tasks[task.task_id] = task
            self._next_id = max(self._next_id, task.task_id + 1)
        for task_id in forgotten:
            self._tasks.pop(task_id, None)
        self._completions.add(completion, clients)

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue is paused."""
        self._paused = paused

    async def clear(self) -> None:
        """Forget everything and begin again with task 1, as another store with another id."""
        self._tasks.clear()
        self._next_id = 1
        self._paused = False
        self._store_id = present_chance().randbytes(16)
        self._completions = CompletionIndex()

    async def close(self) -> None:
        """Keep everything: the same object can be used again."""
