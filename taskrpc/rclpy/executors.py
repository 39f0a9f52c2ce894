"""Who runs a node's callbacks: the thread that spins, or a pool of threads."""

from __future__ import annotations

import os
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import CoroutineType, TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from ._entity import Entity
from ._running import Callback, current_callback, ended, started
from ._sleep import Sleep
from .context import Context
from .exceptions import InvalidHandle
from .future import Future
from .task import Task
from .utilities import get_default_context

if TYPE_CHECKING:
    from .node import Node


class TimeoutException(Exception):
    """Nothing was ready within the time."""


class ShutdownException(Exception):
    """The executor was shut down."""


class ExternalShutdownException(Exception):
    """The context was shut down by another thread or a signal while an executor was spinning."""


class ConditionReachedException(Exception):
    """What the executor was to spin for is there."""


class TimeoutObject:
    """Seconds that are still left of a timeout; may be changed between two spins."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout


class Work(NamedTuple):
    """One thing to run: a task, or one thing that arrived at an entity."""

    task: Task[Any] | None
    entity: Entity | None
    node: Any


def _never() -> bool:
    return False


class Executor:
    """Waits until something arrives at its nodes' entities, and runs their callbacks.

    A subclass says on which threads (`spin_once`).
    """

    def __init__(self, *, context: Context | None = None) -> None:
        self._context = get_default_context() if context is None else context
        self._nodes: dict[Node, None] = {}
        self._nodes_lock = threading.RLock()
        self._sleep = Sleep()
        self._layout: list[tuple[Entity, Any]] | None = None
        self._round: deque[Work] = deque()
        self._tasks_were_last = False
        self._ready_tasks: deque[Task[Any]] = deque()
        self._made = 0
        self._is_shutdown = False
        self._context._sleeps.add(self._sleep)

    @property
    def context(self) -> Context:
        """The context whose end ends the spinning."""
        return self._context

    def create_task(self, callback: Callable[..., Any], *args: Any, **kwargs: Any) -> Task[Any]:
        """Have whoever spins run a function or coroutine function; the future of its result."""
        task: Task[Any] = Task(callback, args, kwargs, executor=self)
        self._keep(task)
        self._resume(task)
        return task

    def create_future(self) -> Future[Any]:
        """A future whose done callbacks this executor runs."""
        return Future(executor=self)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Run no more callbacks, and let go of the nodes; always True."""
        self._is_shutdown = True
        with self._nodes_lock:
            self._nodes.clear()
            self._layout = None
        self._round.clear()
        self._notify()
        return True

    def add_node(self, node: Node) -> bool:
        """Run this node's callbacks, and no other executor; False if it is here already."""
        with self._nodes_lock:
            if node in self._nodes:
                return False
            self._nodes[node] = None
        node.executor = self
        self.wake()
        return True

    def remove_node(self, node: Node) -> None:
        """Run this node's callbacks no longer."""
        with self._nodes_lock:
            self._nodes.pop(node, None)
        self.wake()

    def get_nodes(self) -> list[Node]:
        """The nodes whose callbacks it runs."""
        with self._nodes_lock:
            return list(self._nodes)

    def wake(self) -> None:
        """Look anew what the nodes have: something was created or destroyed."""
        self._layout = None
        self._sleep.end()

    def spin(self) -> None:
        """Run callbacks until the executor or its context is shut down."""
        while self._context.ok() and not self._is_shutdown:
            self.spin_once()

    def spin_until_future_complete(
        self, future: Future[Any], timeout_sec: float | None = None
    ) -> None:
        """Run callbacks until the future is done or cancelled, `timeout_sec` seconds at most."""
        future._when_done(self._notify)
        end = None if timeout_sec is None or timeout_sec < 0 else time.perf_counter() + timeout_sec
        left = None if end is None else TimeoutObject(timeout_sec or 0)
        while (
            not future._done
            and not future._cancelled
            and self._context.ok()
            and not self._is_shutdown
        ):
            self.spin_once_until_future_complete(future, left)
            if end is not None and left is not None:
                left.timeout = end - time.perf_counter()
                if left.timeout <= 0:
                    return

    def spin_once(self, timeout_sec: float | TimeoutObject | None = None) -> None:
        """Wait at most `timeout_sec` seconds for something to arrive, and run one callback.

        None and a negative number wait without end; 0 does not wait.
        """
        raise NotImplementedError

    def spin_once_until_future_complete(
        self, future: Future[Any], timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """As `spin_once`, but wait no longer when the future is done."""
        raise NotImplementedError

    def can_execute(self, entity: Entity) -> bool:
        """Whether a callback of this entity may begin now."""
        return not entity._executor_event and (
            entity.callback_group is None or entity.callback_group.can_execute(entity)
        )

    def wait_for_ready_callbacks(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        nodes: Sequence[Node] | None = None,
        condition: Callable[[], bool] = _never,
    ) -> tuple[Task[Any], Entity | None, Any]:
        """Wait for something to do: a task to be called, and the entity and node it comes from.

        Raises TimeoutException, ShutdownException or ConditionReachedException when there is none,
        and ExternalShutdownException when the context was shut down.
        """
        work = self._next(timeout_sec, nodes, condition)
        if work is None:
            if self._is_shutdown:
                raise ShutdownException
            raise ConditionReachedException if condition() else TimeoutException
        if work.task is None and work.entity is not None:
            return Task(self._run_entity, (work.entity,), executor=self), work.entity, work.node
        assert work.task is not None
        return work.task, work.entity, work.node

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.shutdown()

    def _wait_for_ready_callbacks(
        self,
        timeout_sec: float | TimeoutObject | None = None,
        nodes: Sequence[Node] | None = None,
        condition: Callable[[], bool] = _never,
    ) -> Generator[tuple[Task[Any], Entity | None, Any], None, None]:
        """`wait_for_ready_callbacks` again and again."""
        while True:
            yield self.wait_for_ready_callbacks(timeout_sec, nodes, condition)

    def _notify(self) -> None:
        """Wake whoever spins: something arrived; from any thread and from signal handlers."""
        self._sleep.end()

    # Finding work: rounds of what is ready, tasks and entities in turn

    def _next(
        self,
        timeout_sec: float | TimeoutObject | None,
        nodes: Sequence[Node] | None = None,
        condition: Callable[[], bool] = _never,
    ) -> Work | None:
        """The next thing to run; None at the timeout, the condition or the executor's shutdown."""
        if isinstance(timeout_sec, TimeoutObject):
            timeout_sec = timeout_sec.timeout
        end = None
        while not self._is_shutdown and not condition():
            if (work := self._take_from_round(nodes)) is not None:
                return work
            seen = self._sleep.state
            due = self._begin_round(nodes)
            if self._round:
                continue
            if end is None and timeout_sec is not None and timeout_sec >= 0:
                end = time.perf_counter() + timeout_sec
            left = due
            if end is not None:
                rest = end - time.perf_counter()
                if rest <= 0:
                    return None
                left = rest if due is None else min(due, rest)
            self._sleep.until_ended(seen, left)
        return None

    def _take_from_round(self, nodes: Sequence[Node] | None) -> Work | None:
        usable = self._nodes if nodes is None else nodes
        while self._round:
            try:
                work = self._round.popleft()
            except IndexError:  # another thread spins here, too
                return None
            if work.node is not None and work.node not in usable:
                if work.task is not None:
                    self._ready_tasks.append(work.task)
            elif work.task is not None:
                if work.task._runnable():
                    return work
            elif work.entity is not None and self.can_execute(work.entity):
                return work
        return None

    def _begin_round(self, nodes: Sequence[Node] | None) -> float | None:
        """Collect what is ready; the seconds until the next timer is, None without one."""
        if self._ready_tasks and not self._tasks_were_last:
            self._tasks_were_last = True
            self._collect_tasks()
            return None
        self._tasks_were_last = False
        if not self._context.ok():
            if self._is_shutdown:
                return None
            raise ExternalShutdownException
        due = self._collect_entities(nodes)
        if not self._round and self._ready_tasks:
            self._collect_tasks()
        return due

    def _collect_tasks(self) -> None:
        """The youngest first, as in ROS's Jazzy."""
        tasks = []
        while self._ready_tasks:
            tasks.append(self._ready_tasks.popleft())
        tasks.sort(key=lambda task: -task._number)
        self._round.extend(Work(task, task._entity, task._node) for task in tasks)

    def _collect_entities(self, nodes: Sequence[Node] | None) -> float | None:
        nanoseconds = None
        for entity, node in self._entities(nodes):
            if entity._is_timer:
                wait = entity._wait_ns()
                if wait is None:
                    continue
                if wait > 0:
                    nanoseconds = wait if nanoseconds is None else min(wait, nanoseconds)
                    continue
            elif not entity._ready():
                continue
            if self.can_execute(entity):
                self._round.append(Work(None, entity, node))
        return None if nanoseconds is None else nanoseconds * 1e-9

    def _entities(self, nodes: Sequence[Node] | None) -> list[tuple[Entity, Any]]:
        if nodes is not None:
            return [pair for node in nodes for pair in _entities_of(node)]
        layout = self._layout
        if layout is None:
            seen = self._sleep.state
            layout = [pair for node in self.get_nodes() for pair in _entities_of(node)]
            if self._sleep.state is seen:  # else something changed meanwhile: look anew next time
                self._layout = layout
        return layout

    # Running it

    def _run(self, work: Work) -> None:
        """Run one piece of work to its end or its first `await`; raises what it raises."""
        if work.task is not None:
            self._run_task(work.task)
        elif work.entity is not None:
            self._run_entity(work.entity)

    def _run_entity(self, entity: Entity) -> None:
        group = entity.callback_group
        if group is not None and not group.beginning_execution(entity):
            entity._executor_event = False
            return
        before = started(entity, self)
        waiting = False
        try:
            call = self._taken(entity)
            result = None if call is None else call()
            if type(result) is CoroutineType:
                waiting = self._begin_coroutine(result, entity)
        finally:
            ended(before)
            if not waiting and group is not None:
                group.ending_execution(entity)

    def _taken(self, entity: Entity) -> Callable[[], Any] | None:
        try:
            return entity._take()
        except InvalidHandle:  # destroyed meanwhile
            return None
        finally:
            entity._executor_event = False

    def _begin_coroutine(self, coroutine: CoroutineType[Any, Any, Any], entity: Entity) -> bool:
        """Run a callback's coroutine until it waits for something; whether it does."""
        task: Task[Any] = Task(lambda: None, executor=self)
        task._handler = coroutine
        task._entity, task._node = entity, entity._node
        self._keep(task)
        task()
        if task._done:
            _raise_of(task)
            return False
        task._when_done(lambda: self._coroutine_ended(entity))
        return True

    def _coroutine_ended(self, entity: Entity) -> None:
        if entity.callback_group is not None:
            entity.callback_group.ending_execution(entity)
        self._notify()

    def _run_task(self, task: Task[Any]) -> None:
        before = started(task._entity, self)
        try:
            task()
        finally:
            ended(before)
        if task._done:
            _raise_of(task)

    def _keep(self, task: Task[Any]) -> None:
        self._made += 1
        task._number = self._made

    def _resume(self, task: Task[Any]) -> None:
        """Call a task in the next round; from any thread."""
        self._ready_tasks.append(task)
        self._notify()


def _raise_of(task: Task[Any]) -> None:
    if (error := task.exception()) is not None:
        raise error


def _entities_of(node: Any) -> list[tuple[Entity, Any]]:
    """In the order in which ROS asks them."""
    kinds = (node.waitables, node.timers, node.subscriptions, node.guards, node.clients)
    return [(entity, node) for kind in (*kinds, node.services) for entity in list(kind)]


class SingleThreadedExecutor(Executor):
    """Runs one callback after another on the thread that spins."""

    def spin_once(self, timeout_sec: float | TimeoutObject | None = None) -> None:
        """Wait at most `timeout_sec` seconds for something to arrive, and run one callback."""
        if (work := self._next(timeout_sec)) is not None:
            self._run(work)

    def spin_once_until_future_complete(
        self, future: Future[Any], timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """As `spin_once`, but wait no longer when the future is done."""
        future._when_done(self._notify)
        if (work := self._next(timeout_sec, None, future.done)) is not None:
            self._run(work)


class MultiThreadedExecutor(Executor):
    """Runs callbacks side by side in a pool of threads, as far as their groups allow."""

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        if num_threads is None:
            num_threads = _processors()
        if num_threads == 1:
            warnings.warn(
                "MultiThreadedExecutor is used with a single thread.\n"
                "Use the SingleThreadedExecutor instead.",
                stacklevel=2,
            )
        self._executor = ThreadPoolExecutor(num_threads)
        self._failures: deque[BaseException] = deque()

    def spin_once(self, timeout_sec: float | TimeoutObject | None = None) -> None:
        """Wait at most `timeout_sec` seconds for something to arrive, and let a thread run it.

        Raises what a callback raised that was begun earlier.
        """
        self._spin_once(timeout_sec, _never)

    def spin_once_until_future_complete(
        self, future: Future[Any], timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """As `spin_once`, but wait no longer when the future is done."""
        future._when_done(self._notify)
        self._spin_once(timeout_sec, future.done)

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Run no more callbacks, and wait for those that run (not when called by one of them)."""
        done = super().shutdown(timeout_sec)
        self._executor.shutdown(wait=wait_for_threads and current_callback() is None)
        return done

    def _spin_once(
        self, timeout_sec: float | TimeoutObject | None, condition: Callable[[], bool]
    ) -> None:
        try:
            work = self._next(timeout_sec, None, lambda: bool(self._failures) or condition())
        except ExternalShutdownException:
            return
        if self._failures:
            raise self._failures.popleft()
        if work is None:
            return
        if work.task is None and work.entity is not None:
            work.entity._executor_event = True
        self._executor.submit(self._work, work)

    def _work(self, work: Work) -> None:
        """One piece of work on a thread of the pool."""
        try:
            if not self._is_shutdown:
                self._run(work)
        except BaseException as error:
            self._failures.append(error)
        finally:
            self._notify()


def _processors() -> int:
    """How many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 2


__all__ = [
    "Callback",
    "ConditionReachedException",
    "Executor",
    "ExternalShutdownException",
    "MultiThreadedExecutor",
    "ShutdownException",
    "SingleThreadedExecutor",
    "TimeoutException",
    "TimeoutObject",
    "current_callback",
]
