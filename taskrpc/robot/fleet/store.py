"""The store of a fleet: the interface to its database, and a database in memory.

All changes go through `transact`: the store takes the fleet's lock, brings this server's copy up to
date, runs the action on the copy and writes what it changed. So every decision is made on the
present state, in one order for all servers. Calls that wait together share a transaction.
"""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Generic, TypeAlias, TypeVar

from taskrpc.errors import OutcomeUnknown, StoreError, TaskRpcError, text_for_callers
from taskrpc.robot.fleet.model import Meta, RobotRecord
from taskrpc.robot.fleet.state import Changes, FleetState
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records.history import AT_ONCE, DEFAULT, History
from taskrpc.robot.tasks.records.store import Stored
from taskrpc.spi import ClientKey, Completion, CompletionIndex, present_chance

log = logging.getLogger("taskrpc.fleet")

T = TypeVar("T")

Action: TypeAlias = Callable[[FleetState, float], T]
"""Reads and changes the state at a time of the database's clock. It may run more than once, and it
may raise: then it has changed nothing."""

RequestKey: TypeAlias = tuple[str, bytes, int]
"""A request of an exactly-once service: its principal, client and sequence number."""

ChangeListener: TypeAlias = Callable[[Sequence[int]], object]
"""Gets the ids of the changed tasks; an empty sequence if anything else has changed."""

_MOST_AT_ONCE = 256  # actions in one transaction


class AlreadyCompleted(StoreError):
    """Another server has completed the same request: nothing was done."""

    def __init__(self, completion: Completion) -> None:
        self.completion = completion
        super().__init__("another server of the fleet has completed this request")


class Pending(Generic[T]):
    """An action that waits for its transaction."""

    __slots__ = ("action", "done", "request", "since")

    def __init__(
        self, action: Action[T], request: RequestKey | None, loop: asyncio.AbstractEventLoop
    ) -> None:
        self.action = action
        self.request = request
        self.done: asyncio.Future[T] = loop.create_future()
        self.since = loop.time()


Outcome: TypeAlias = tuple[Any, Exception | None]
"""The result of an action, or its error."""


def carry_out(
    state: FleetState,
    now: float,
    batch: Iterable[Pending[Any]],
    completed: dict[RequestKey, Completion],
) -> list[Outcome]:
    """Run the actions of a transaction; `completed` has the known completions of their requests."""
    outcomes: list[Outcome] = []
    for pending in batch:
        mark = state.mark()
        known = None if pending.request is None else completed.get(pending.request)
        try:
            if known is not None:
                raise AlreadyCompleted(known)
            outcomes.append((pending.action(state, now), None))
        except Exception as error:
            state.undo(mark)
            outcomes.append((None, error))
            continue
        for completion, _ in state.changes.completions[-1:]:
            if completion is not None:
                key = completion.principal, completion.client, completion.sequence
                completed[key] = completion
    if not state.changes.is_empty:
        changes, notifies = state.changes, state.changes.notifies
        state.set_meta(revision=state.meta.revision + 1)
        changes.notifies = notifies
    return outcomes


class FleetStore(ABC):
    """A server's access to the database of its fleet; it also is a `TaskStore`.

    Args:
        history: which ended tasks are kept; all servers of a fleet need the same.
    """

    def __init__(self, *, history: History = DEFAULT) -> None:
        self.history = history
        """Which ended tasks are kept."""
        self.state = FleetState(history=history)
        """This server's copy. A transaction that is being written is visible in it already."""
        self.listeners: list[ChangeListener] = []
        """Called after each change of the copy that is stored."""
        self._waiting: deque[Pending[Any]] = deque()
        self._writing: asyncio.Task[None] | None = None
        self._following: asyncio.Task[None] | None = None
        self._exclusive = asyncio.Lock()
        """Held while the copy follows the database or a transaction runs."""
        self.last_problem = ""
        """Why the database could not be used at last, as callers may read it; "" if it could."""

    # What servers call

    def now(self) -> float:
        """Return the database's clock, in seconds since 1970, as far as it is known."""
        return self._now()

    def transact(self, action: Action[T], request: RequestKey | None = None) -> asyncio.Future[T]:
        """Run an action in a transaction; await the future that it returns.

        Raises:
            AlreadyCompleted: the database has a completion of `request`; the action did not run.
            StoreError: nothing was changed.
            OutcomeUnknown: the connection was lost while the transaction was being committed.
            Exception: the action raised it.
        """
        pending = Pending(action, request, asyncio.get_running_loop())
        self._waiting.append(pending)
        if self._writing is None:
            self._writing = asyncio.create_task(self._write(), name="taskrpc fleet store")
        return pending.done

    async def refresh(self) -> None:
        """Bring the copy up to date. Raises StoreError."""
        async with self._exclusive:
            self._announce(await self._follow())

    def notified(self) -> None:
        """Follow the database soon: another server has changed it."""
        if self._following is None:
            self._following = asyncio.create_task(self._follow_once(), name="taskrpc fleet")

    async def follow(self, timeout: float) -> str:
        """Bring the copy up to date if that is possible in time; returns why not, "" if it was.

        A transaction that waits for a database that is away does not delay this.
        """
        self.notified()
        assert self._following is not None, "it has just been started"
        done, _ = await asyncio.wait({self._following}, timeout=timeout)
        return self.last_problem if done else "the database does not answer"

    async def _follow_once(self) -> None:
        try:
            async with self._exclusive:
                self._following = None  # a notification from here on needs another look
                self._announce(await self._follow())
                self.last_problem = ""
        except StoreError as error:
            self.last_problem = text_for_callers(error)

    @abstractmethod
    async def look_up(self, client: ClientKey) -> Sequence[Completion]:
        """Return the completions of a client. Raises StoreError."""

    @abstractmethod
    async def forget_old_clients(self) -> None:
        """Forget the completions of clients whose lease has ended. Raises StoreError."""

    @abstractmethod
    async def store_id(self) -> bytes:
        """Return the id that all servers of the database share. Raises StoreError."""

    @abstractmethod
    async def close(self) -> None:
        """Release the database; a later call opens it again."""

    # What databases implement

    @abstractmethod
    def _now(self) -> float: ...

    @abstractmethod
    async def _follow(self) -> list[int] | None:
        """Bring the copy up to date; returns the changed tasks, None if nothing has changed."""

    @abstractmethod
    async def _commit(self, batch: Sequence[Pending[Any]]) -> tuple[list[Outcome], list[int]]:
        """Run actions in one transaction; returns their outcomes and all changed tasks.

        Raises StoreError or OutcomeUnknown.
        """

    @abstractmethod
    async def _all_completions(self) -> Sequence[Completion]: ...

    async def _write(self) -> None:
        try:
            while self._waiting:
                count = min(len(self._waiting), _MOST_AT_ONCE)
                batch = [self._waiting.popleft() for _ in range(count)]
                async with self._exclusive:
                    await self._write_batch(batch)
        finally:
            self._writing = None

    async def _write_batch(self, batch: list[Pending[Any]]) -> None:
        try:
            outcomes, changed = await self._commit(batch)
        except BaseException as error:
            if not isinstance(error, TaskRpcError):
                log.exception("the store of the fleet failed")
            self.last_problem = "the store failed"
            if isinstance(error, TaskRpcError):
                self.last_problem = text_for_callers(error)
            for pending in batch:
                if not pending.done.done():
                    pending.done.set_exception(_own_error(error))
                    pending.done.exception()  # else asyncio warns where no coroutine waits
            if not isinstance(error, Exception):
                raise
            return
        self.last_problem = ""
        for pending, (result, problem) in zip(batch, outcomes, strict=True):
            if pending.done.done():
                continue
            if problem is None:
                pending.done.set_result(result)
            else:
                pending.done.set_exception(problem)
                pending.done.exception()
        self._announce(changed)

    def _announce(self, changed: list[int] | None) -> None:
        if changed is not None:
            for listener in self.listeners:
                listener(changed)

    async def _idle(self) -> None:
        """Wait until no transaction runs."""
        while running := {each for each in (self._writing, self._following) if each is not None}:
            await asyncio.wait(running)

    # A `TaskStore`, so that one suite of tests holds for every store

    async def load(self) -> Stored:
        """Return everything that the database holds; see `TaskStore.load`."""
        await self._idle()
        await self.refresh()
        tasks = tuple(self.state.tasks[task_id] for task_id in sorted(self.state.tasks))
        completions = tuple(await self._all_completions())
        meta = self.state.meta
        return Stored(tasks, meta.next_id, await self.store_id(), meta.paused, completions)

    def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
    ) -> asyncio.Future[None]:
        """Remember and forget tasks and completions; see `TaskStore.apply`."""

        def action(state: FleetState, now: float) -> None:
            for task in saved:
                state.put_task(task)
            for task_id in forgotten:
                if task_id in state.tasks:
                    state.forget_task(task_id)
            newest = max((task.task_id for task in saved), default=0)
            if newest >= state.meta.next_id:
                state.set_meta(next_id=newest + 1)
            state.complete(completion, clients)

        return self.transact(action)

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue is paused."""
        await self.transact(lambda state, now: state.set_meta(paused=paused))

    async def clear(self) -> None:
        """Forget all tasks and completions, and begin again with task 1, with another id.

        Raises:
            StoreError: another server of the fleet runs.
        """

        def action(state: FleetState, now: float) -> None:
            if live := state.live_robots(now):
                names = ", ".join(robot.name for robot in live)
                raise StoreError(f"other servers of the fleet use these tasks: {names}; stop them")
            state.clear()

        await self.transact(action)


def _own_error(error: BaseException) -> Exception:
    """Return an error for one caller: callers must not share an exception and its traceback."""
    if isinstance(error, OutcomeUnknown):
        return OutcomeUnknown(str(error))
    if isinstance(error, StoreError):
        copy = StoreError(str(error))
        copy.for_callers = error.for_callers
        return copy
    if isinstance(error, asyncio.CancelledError):
        return OutcomeUnknown("the server ended while this was being stored")
    return OutcomeUnknown(f"the store failed: {error}")


class MemoryFleet:
    """A database in memory that several `MemoryFleetStore` share, for tests and demonstrations.

    Args:
        clock: returns seconds since 1970.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.meta = Meta()
        self.store_id = present_chance().randbytes(16)
        self.tasks: dict[int, tuple[int, Task]] = {}
        """Each with the revision of its last change."""
        self.archive: list[Task] = []
        """The archived tasks, the oldest first."""
        self.robots: dict[str, tuple[int, RobotRecord]] = {}
        self.completions = CompletionIndex()
        self.stores: list[MemoryFleetStore] = []
        """The stores that are told about changes."""

    def write(self, meta: Meta, changes: Changes, history: History) -> None:
        """Write the changes of a transaction."""
        if changes.cleared:
            self.tasks.clear()
            self.archive.clear()
            self.store_id = present_chance().randbytes(16)
            self.completions = CompletionIndex()
        for task_id, task in changes.tasks.items():
            before = self.tasks.pop(task_id, None)
            if task is not None:
                self.tasks[task_id] = meta.revision, task
            elif before is not None and before[1].state.is_ended and history.archived != 0:
                self.archive.append(before[1])
        if (now := changes.newest_end()) is not None:
            self._prune(history, now)
        for robot in changes.robots.values():
            self.robots[robot.name] = meta.revision, robot
        for completion, clients in changes.completions:
            self.completions.add(completion, clients)
        self.meta = meta

    def _prune(self, history: History, now: float) -> None:
        if history.archived is not None:
            surplus = max(0, len(self.archive) - history.archived)
            del self.archive[: min(surplus, AT_ONCE)]
        if (kept_since := history.kept_since(now)) is not None:
            old = sum((task.ended_at or 0.0) < kept_since for task in self.archive[:AT_ONCE])
            del self.archive[:old]


class MemoryFleetStore(FleetStore):
    """One server's access to a `MemoryFleet`, with faults that tests switch on.

    Args:
        database: shared with the other servers.
        latency: seconds that each transaction takes.
        history: see `FleetStore`.
    """

    def __init__(
        self, database: MemoryFleet, *, latency: float = 0.0, history: History = DEFAULT
    ) -> None:
        super().__init__(history=history)
        self.database = database
        self.latency = latency
        self.is_cut_off = False
        """Whether the database cannot be reached."""
        self.gets_notifications = True
        """Whether the database can tell this store about changes."""
        self.loses_commit = False
        """Whether the connection is lost during the next commit, after it has taken effect."""
        database.stores.append(self)

    def _now(self) -> float:
        return self.database.clock()

    async def look_up(self, client: ClientKey) -> Sequence[Completion]:
        """Return the completions of a client."""
        self._check()
        found = self.database.completions.all()
        return [each for each in found if (each.principal, each.client) == client]

    async def forget_old_clients(self) -> None:
        """Do nothing: a database in memory does not last so long."""

    async def store_id(self) -> bytes:
        """Return the id of the database."""
        return self.database.store_id

    async def close(self) -> None:
        """Wait for the running transactions."""
        await self._idle()

    async def _all_completions(self) -> Sequence[Completion]:
        return self.database.completions.all()

    async def _follow(self) -> list[int] | None:
        self._check()
        return self._catch_up()

    def _catch_up(self) -> list[int] | None:
        database, known = self.database, self.state.meta.revision
        if database.meta.revision == known:
            return None
        tasks = [task for revision, task in database.tasks.values() if revision > known]
        robots = [robot for revision, robot in database.robots.values() if revision > known]
        return self.state.replace(database.meta, tasks, robots)

    async def _commit(self, batch: Sequence[Pending[Any]]) -> tuple[list[Outcome], list[int]]:
        if self.latency:
            await asyncio.sleep(self.latency)
        self._check()
        changed = self._catch_up() or []
        wanted = {pending.request for pending in batch} - {None}
        completed = {}
        if wanted:
            for each in self.database.completions.all():
                completed[each.principal, each.client, each.sequence] = each
        outcomes = carry_out(self.state, self._now(), batch, completed)
        changes = self.state.take_changes()
        if not changes.is_empty:
            self.database.write(self.state.meta, changes, self.history)
            if changes.notifies:
                self._tell_others()
        if self.loses_commit:
            self.loses_commit = False
            raise OutcomeUnknown("the connection to the database was lost during a commit")
        return outcomes, [*changed, *changes.tasks]

    def _check(self) -> None:
        if self.is_cut_off:
            raise StoreError("the database cannot be reached")

    def _tell_others(self) -> None:
        loop = asyncio.get_running_loop()
        for store in self.database.stores:
            if store is not self and store.gets_notifications and not store.is_cut_off:
                loop.call_soon(store.notified)
