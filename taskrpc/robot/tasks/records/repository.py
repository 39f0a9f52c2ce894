"""The repository of all tasks: it stores each change, then knows it, then announces it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, TypeAlias

import msgspec

from taskrpc.errors import TaskRpcError, text_for_callers
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.records.change_feed import ChangeFeed
from taskrpc.robot.tasks.records.history import newest_end
from taskrpc.robot.tasks.records.store import TaskStore
from taskrpc.spi import ClientKey, Completion, StoredCompletions

OnStored: TypeAlias = Callable[[BaseException | None], object]
"""The repository calls it with None when a change is stored, or with the error if it is not."""


class TaskRepository:
    """Every remembered task, as the store has it.

    Args:
        store: keeps the tasks for the next server.
        change_feed: announces the changes.
    """

    def __init__(self, store: TaskStore, change_feed: ChangeFeed) -> None:
        self.change_feed = change_feed
        self._store = store
        self._tasks: dict[int, Task] = {}
        # Two ordered sets of task ids, the oldest end first.
        self._ended: dict[int, None] = {}  # without the interrupted tasks
        self._interrupted: dict[int, None] = {}
        self._commits: dict[int, asyncio.Future[None]] = {}  # task_id -> its newest commit
        self._next_id = 1
        self._next_arrival = 1
        self._problem = ""  # why the store refused the last change, "" if it did not
        self._is_paused = False  # as stored, or as being stored
        self.was_paused = False
        """Whether the queue was paused when the earlier server ended."""

    async def open(self) -> list[Task]:
        """Read the store; returns every task in it. Raises StoreError."""
        stored = await self._store.load()
        self._next_id = stored.next_id
        self.was_paused = self._is_paused = stored.paused
        self._next_arrival = 1 + max((task.arrival for task in stored.tasks), default=0)
        for task in sorted(stored.tasks, key=lambda task: task.ended_at or 0.0):
            self._remember(task)
        return list(stored.tasks)

    async def close(self) -> None:
        """Wait for the changes that are being stored, then close the store."""
        if self._commits:
            await asyncio.wait(self._commits.values())
        await self._store.close()

    def new_id(self) -> int:
        """Return the next task id; each is given once."""
        self._next_id += 1
        return self._next_id - 1

    def new_arrival(self) -> int:
        """Return the next number in the order of arrival."""
        self._next_arrival += 1
        return self._next_arrival - 1

    def find(self, task_id: int) -> Task | None:
        """Return the task with this id as the store has it, None if there is none."""
        return self._tasks.get(task_id)

    def tasks(self) -> Iterable[Task]:
        """Return every remembered task."""
        return self._tasks.values()

    def ended(self) -> Iterator[Task]:
        """Iterate over the ended tasks: the interrupted ones, then the others, newest first."""
        task_ids = (*reversed(self._interrupted), *reversed(self._ended))
        return (self._tasks[task_id] for task_id in task_ids)

    @property
    def interrupted(self) -> Collection[int]:
        """The ids of the interrupted tasks, which wait for the operator's decision."""
        return self._interrupted.keys()

    def save(
        self,
        *tasks: Task,
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
        undo: Callable[[], object] = lambda: None,
    ) -> asyncio.Future[None]:
        """Store tasks and announce them; await the future that it returns.

        The change is stored even if the caller stops waiting. `completion` is the completed
        request that brought the tasks, and the store forgets the completions of `clients`; both
        are stored with the tasks. `undo` is called if nothing is announced, before the future is
        resolved.

        Raises:
            StoreError: nothing was stored and nothing announced.
            OutcomeUnknown: nothing was announced; the next server will see what was stored.
        """
        # A future of the caller's own, which the caller may cancel, resolved by a callback. An
        # asyncio task with a shield would take five turns of the event loop for each change.
        saved = asyncio.get_running_loop().create_future()
        resolve = partial(resolve_future, saved)
        self.save_with_callback(resolve, *tasks, completion=completion, clients=clients, undo=undo)
        return saved

    def save_with_callback(
        self,
        on_stored: OnStored,
        *tasks: Task,
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
        undo: Callable[[], object] = lambda: None,
    ) -> None:
        """Do as `save` does, and call `on_stored` at its end."""
        forgotten = self._surplus(tasks)
        try:
            storing = self._store.apply(tasks, forgotten, completion, clients)
            # `ensure_future` would make the same check with five function calls.
            if not isinstance(storing, asyncio.Future):
                storing = asyncio.ensure_future(storing)
        except BaseException as error:  # a store whose `apply` is a plain function may raise here
            self._undo(undo, error)
            raise
        commit = storing
        for task in tasks:
            self._commits[task.task_id] = commit
        commit.add_done_callback(partial(self._committed, on_stored, tasks, forgotten, undo))

    async def forget_ended(self) -> None:
        """Forget the ended tasks, except those that are about to change. Raises StoreError."""
        forgotten = [task_id for task_id in self._ended if task_id not in self._commits]
        await self._store.apply([], forgotten)
        self._announce((), forgotten)
        self.change_feed.announce()

    async def remember_pause(self, paused: bool) -> None:
        """Store whether the queue is paused; raises StoreError."""
        before, self._is_paused = self._is_paused, paused
        try:
            await self._store.remember_pause(paused)
        except BaseException as error:
            self._is_paused = before
            if isinstance(error, TaskRpcError):
                self._problem = text_for_callers(error)
            raise

    async def problem(self) -> str:
        """Return why the store refused its last change, "" if it works; retries it first."""
        if self._problem:
            with contextlib.suppress(TaskRpcError):
                await self._try_store()
                self._problem = ""
        return self._problem

    async def _try_store(self) -> None:
        """Store again what is stored already: one of each kind that a submit writes."""
        await self.remember_pause(self._is_paused)
        newest = next(reversed(self._tasks), 0)
        if self.is_settled(newest):
            await self._store.apply([self._tasks[newest]])

    async def stored(self, task_id: int) -> Task | None:
        """Wait until no change of a task is being stored; return it, None if there is none.

        Wait before a change that may be undone. If two changes of a task were being stored, the
        store could refuse both. The undo of the second change would then restore the state after
        the first, which was never stored.
        """
        while commit := self._commits.get(task_id):
            await asyncio.wait({commit})
        return self._tasks.get(task_id)

    def is_settled(self, task_id: int) -> bool:
        """Return whether a task is stored and no further change of it is being stored."""
        return task_id in self._tasks and task_id not in self._commits

    def announce_progress(self, task_id: int, progress: float) -> None:
        """Announce a task's progress, which is not stored."""
        self._tasks[task_id] = msgspec.structs.replace(self._tasks[task_id], progress=progress)
        self.change_feed.announce(task_id)

    def announce_unstored(self, task: Task) -> None:
        """Announce a change that the store refused, where hiding it would be worse."""
        self._remember(task)
        self.change_feed.announce(task.task_id)

    def _committed(
        self,
        on_stored: OnStored,
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
            self._announce(tasks, forgotten)
        else:
            self._undo(undo, error)
        on_stored(error)

    def _undo(self, undo: Callable[[], object], error: BaseException) -> None:
        if isinstance(error, TaskRpcError):
            self._problem = text_for_callers(error)
        undo()

    def _announce(self, tasks: tuple[Task, ...], forgotten: list[int]) -> None:
        for task_id in forgotten:
            self._tasks.pop(task_id, None)
            self._ended.pop(task_id, None)
        for task in tasks:
            self._remember(task)
            self.change_feed.announce(task.task_id)

    def _remember(self, task: Task) -> None:
        self._tasks[task.task_id] = task
        self._ended.pop(task.task_id, None)
        self._interrupted.pop(task.task_id, None)
        if task.state is TaskState.INTERRUPTED:
            self._interrupted[task.task_id] = None
        elif task.state.is_ended:
            self._ended[task.task_id] = None

    def _surplus(self, tasks: tuple[Task, ...]) -> list[int]:
        """Return the ids of the ended tasks to forget when these tasks are stored.

        A task that is being stored stays: it may be about to be queued again.
        """
        ending = [task for task in tasks if task.state.is_ended]
        ending = [task for task in ending if task.state is not TaskState.INTERRUPTED]
        if not ending:
            return []
        busy = {*self._commits, *(task.task_id for task in tasks)}
        idle = (self._tasks[task_id] for task_id in self._ended if task_id not in busy)
        now, count = newest_end(ending) or 0.0, len(self._ended) + len(ending)
        return self._store.history.surplus(idle, count, now)


def resolve_future(future: asyncio.Future[None], error: BaseException | None) -> None:
    """Resolve a future as an `OnStored` callback."""
    if future.done():
        return  # the caller has cancelled it
    if error is None:
        future.set_result(None)
    elif isinstance(error, asyncio.CancelledError):
        future.cancel()
    else:
        future.set_exception(error)


class TaskCompletions:
    """A `CompletionStore` that keeps completed requests in the task server's store.

    Another server may still have the service's name, and then the store belongs to that server:
    this class does not touch the store before `opened` is called.
    """

    def __init__(self, store: TaskStore, repository: TaskRepository) -> None:
        self._store = store
        self._repository = repository
        self._is_open = asyncio.Event()

    def opened(self) -> None:
        """Note that the task server has read the store."""
        self._is_open.set()

    async def recall(self) -> StoredCompletions:
        """Return the completed requests; waits until the task server has read the store."""
        await self._is_open.wait()
        stored = await self._store.load()
        return StoredCompletions(stored.store_id, stored.completions)

    async def complete(
        self, completion: Completion | None, effect: Any, forgotten: Sequence[ClientKey] = ()
    ) -> None:
        """Store a completion without a task, and forget the completions of clients."""
        assert effect is None, "handlers store their tasks themselves, with the completion"
        await self._repository.save(completion=completion, clients=forgotten)
