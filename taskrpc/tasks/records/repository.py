"""The book of all tasks: each change is stored first, then known here, then announced."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import TypeAlias

import msgspec

from taskrpc.errors import TaskRpcError, told
from taskrpc.request_ids.ids import Client, Completion
from taskrpc.tasks.model import State, Task
from taskrpc.tasks.records.change_feed import Board
from taskrpc.tasks.records.store import TaskStore

Then: TypeAlias = Callable[[BaseException | None], object]
"""Learns that something is stored, or of the error if it is not."""


class TaskBook:
    """Every task that is remembered, as the store has it.

    Args:
        store: where tasks survive.
        board: where changes are announced.
        keep_ended: how many ended tasks are remembered; the oldest are forgotten. Interrupted
            tasks are never forgotten and do not count: a person decides about each of them.
    """

    def __init__(self, store: TaskStore, board: Board, *, keep_ended: int = 1000) -> None:
        self.board = board
        self._store = store
        self._keep_ended = keep_ended
        self._tasks: dict[int, Task] = {}
        # Two ordered sets, the oldest end first.
        self._ended: dict[int, None] = {}  # without the interrupted tasks
        self._interrupted: dict[int, None] = {}
        self._commits: dict[int, asyncio.Future[None]] = {}  # task_id -> its newest commit
        self._next_id = 1
        self._next_arrival = 1
        self._problem = ""
        self._is_paused = False  # as the store has it, or will have it
        self.was_paused = False
        """Whether the queue stood still when the server before ended."""

    async def open(self) -> list[Task]:
        """Read the store and return every task in it; raises StoreError."""
        stored = await self._store.load()
        self._next_id = stored.next_id
        self.was_paused = self._is_paused = stored.paused
        self._next_arrival = 1 + max((task.arrival for task in stored.tasks), default=0)
        for task in sorted(stored.tasks, key=lambda task: task.ended_at or 0.0):
            self._note(task)
        return list(stored.tasks)

    async def close(self) -> None:
        """Wait for what is being stored, then close the store."""
        if self._commits:
            await asyncio.wait(self._commits.values())
        await self._store.close()

    def new_id(self) -> int:
        """The number of the next task; each is given once."""
        self._next_id += 1
        return self._next_id - 1

    def new_arrival(self) -> int:
        """The next place in the order of arrival."""
        self._next_arrival += 1
        return self._next_arrival - 1

    def find(self, task_id: int) -> Task | None:
        """The task of this number as the store has it, None if there is none."""
        return self._tasks.get(task_id)

    def tasks(self) -> Iterable[Task]:
        """Every task that is remembered."""
        return self._tasks.values()

    def ended(self) -> Iterator[Task]:
        """Iterate over the ended tasks: the interrupted ones, then the others, newest first."""
        numbers = (*reversed(self._interrupted), *reversed(self._ended))
        return (self._tasks[task_id] for task_id in numbers)

    @property
    def interrupted(self) -> Collection[int]:
        """The numbers of the interrupted tasks, which wait for the operator's decision."""
        return self._interrupted.keys()

    def save(
        self,
        *tasks: Task,
        completion: Completion | None = None,
        clients: Sequence[Client] = (),
        undo: Callable[[], object] = lambda: None,
    ) -> asyncio.Future[None]:
        """Store tasks and announce them; await what it returns.

        It runs to its end even if its caller stops waiting.

        The completion of the request that brought the tasks, and what else the store shall forget
        of clients, are stored with them. `undo` is called where nothing was announced, before
        anybody hears of it.

        Raises:
            StoreError: nothing was stored and nothing announced.
            OutcomeUnknown: nothing was announced; the next server will know what was stored.
        """
        # Callbacks, and a future of the caller's own, which he may cancel: a task and a shield
        # before it would take five turns of the loop for each change.
        saved = asyncio.get_running_loop().create_future()
        then = partial(settle, saved)
        self.save_then(then, *tasks, completion=completion, clients=clients, undo=undo)
        return saved

    def save_then(
        self,
        then: Then,
        *tasks: Task,
        completion: Completion | None = None,
        clients: Sequence[Client] = (),
        undo: Callable[[], object] = lambda: None,
    ) -> None:
        """Do as `save` does and call back at its end, with what it raises, or None."""
        forgotten = self._surplus(tasks)
        try:
            storing = self._store.apply(tasks, forgotten, completion, clients)
            # Asked here, since `ensure_future` takes five calls to see a future.
            if not isinstance(storing, asyncio.Future):
                storing = asyncio.ensure_future(storing)
        except BaseException as error:  # a store that is not `async` may refuse at once
            self._undo(undo, error)
            raise
        commit = storing
        for task in tasks:
            self._commits[task.task_id] = commit
        commit.add_done_callback(partial(self._committed, then, tasks, forgotten, undo))

    async def remember_pause(self, paused: bool) -> None:
        """Store whether the queue stands still; raises StoreError."""
        before, self._is_paused = self._is_paused, paused
        try:
            await self._store.remember_pause(paused)
        except BaseException as error:
            self._is_paused = before
            if isinstance(error, TaskRpcError):
                self._problem = told(error)
            raise

    async def problem(self) -> str:
        """Why the store refused its last change, "" if it did not; tried once more if it did."""
        if self._problem:
            with contextlib.suppress(TaskRpcError):
                await self._try_store()
                self._problem = ""
        return self._problem

    async def _try_store(self) -> None:
        """Store once more what is stored already, of everything that a submit writes something."""
        await self.remember_pause(self._is_paused)
        newest = next(reversed(self._tasks), 0)
        if self.is_settled(newest):
            await self._store.apply([self._tasks[newest]])

    async def stored(self, task_id: int) -> bool:
        """Wait until nothing about a task is on its way to the store; whether the task is there."""
        while commit := self._commits.get(task_id):
            await asyncio.wait({commit})
        return task_id in self._tasks

    def is_settled(self, task_id: int) -> bool:
        """Whether a task is stored and nothing more about it is on its way to the store."""
        return task_id in self._tasks and task_id not in self._commits

    def note_progress(self, task_id: int, progress: float) -> None:
        """Announce how far a task is; progress is not stored."""
        self._tasks[task_id] = msgspec.structs.replace(self._tasks[task_id], progress=progress)
        self.board.announce(task_id)

    def note_unstored(self, task: Task) -> None:
        """Announce a change that the store refused, where hiding it would be worse."""
        self._note(task)
        self.board.announce(task.task_id)

    def _committed(
        self,
        then: Then,
        tasks: tuple[Task, ...],
        forgotten: list[int],
        undo: Callable[[], object],
        commit: asyncio.Future[None],
    ) -> None:
        for task in tasks:
            if self._commits.get(task.task_id) is commit:
                del self._commits[task.task_id]
        error = asyncio.CancelledError() if commit.cancelled() else commit.exception()
        if error is None:
            self._problem = ""
            self._know(tasks, forgotten)
        else:
            self._undo(undo, error)
        then(error)

    def _undo(self, undo: Callable[[], object], error: BaseException) -> None:
        if isinstance(error, TaskRpcError):
            self._problem = told(error)
        undo()

    def _know(self, tasks: tuple[Task, ...], forgotten: list[int]) -> None:
        for task_id in forgotten:
            self._tasks.pop(task_id, None)
            self._ended.pop(task_id, None)
        for task in tasks:
            self._note(task)
            self.board.announce(task.task_id)

    def _note(self, task: Task) -> None:
        self._tasks[task.task_id] = task
        self._ended.pop(task.task_id, None)
        self._interrupted.pop(task.task_id, None)
        if task.state is State.INTERRUPTED:
            self._interrupted[task.task_id] = None
        elif task.state.is_ended:
            self._ended[task.task_id] = None

    def _surplus(self, tasks: tuple[Task, ...]) -> list[int]:
        """The ended tasks that are too many once these are stored.

        A task that is being stored stays: it may be about to be queued once more.
        """
        ending = [task for task in tasks if task.state.is_ended]
        ending = [task for task in ending if task.state is not State.INTERRUPTED]
        if not ending:
            return []
        busy = {*self._commits, *(task.task_id for task in tasks)}
        idle = (task_id for task_id in self._ended if task_id not in busy)
        return list(islice(idle, max(0, len(self._ended) + len(ending) - self._keep_ended)))


def settle(saved: asyncio.Future[None], error: BaseException | None) -> None:
    """Let whoever awaits a future know of an end, as `save_then` tells it."""
    if saved.done():
        return  # nobody waits any more
    if error is None:
        saved.set_result(None)
    elif isinstance(error, asyncio.CancelledError):
        saved.cancel()
    else:
        saved.set_exception(error)
