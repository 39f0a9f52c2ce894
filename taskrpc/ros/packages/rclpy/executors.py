"""Executors, which run the callbacks of nodes: on the spinning thread or in a pool of threads."""

from __future__ import annotations

import inspect
import os
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import CoroutineType
from typing import Any, Self

from ._impl.bridge import settle
from ._impl.diagnostics.deadlocks import check_spin
from ._impl.execution.entity import (
    Callback,
    Entity,
    current_callback,
    ended,
    is_busy,
    started,
)
from ._impl.execution.scheduler import (
    ExternalShutdownException,
    Scheduler,
    Timeout,
    TimeoutObject,
    Work,
    never,
)
from ._impl.node_interface import NodeInterface
from .context import Context
from .exceptions import InvalidHandle
from .task import Future, Task, raise_once


class TimeoutException(Exception):
    """Nothing was ready before the timeout."""


class ShutdownException(Exception):
    """The executor was shut down."""


class ConditionReachedException(Exception):
    """The condition that the executor was spinning for is true."""


async def await_or_execute(callback: Callable[..., Any], *args: Any) -> Any:
    """Await a coroutine function, call any other."""
    result = callback(*args)
    return await result if inspect.iscoroutinefunction(callback) else result


class Executor(Scheduler):
    """Waits until something arrives at its nodes' entities, and runs their callbacks.

    A subclass decides on which threads they run (`spin_once`).
    """

    runs_one_at_a_time = False
    """Whether a callback that waits prevents every other callback from running."""

    thread_count = 1
    """How many callbacks may run at the same time."""

    @property
    def is_shutdown(self) -> bool:
        """Whether `shutdown` was called."""
        return self._is_shutdown

    @property
    def is_unattended(self) -> bool:
        """Whether callbacks may still run although no thread spins the executor any more."""
        return False

    @property
    def context(self) -> Context:
        """The context; its shutdown ends the spinning."""
        return self._context

    @property
    def is_spinning(self) -> bool:
        """Whether a thread spins it, that is, waits for work or runs a callback."""
        return self._sleep.has_sleepers or is_busy(self)

    def create_task(self, callback: Callable[..., Any], *args: Any, **kwargs: Any) -> Task[Any]:
        """Run a function or coroutine function on the spinning thread; returns its future."""
        task: Task[Any] = Task(callback, args, kwargs, executor=self)
        self._keep(task)
        self.resume_task(task)
        return task

    def create_future(self) -> Future[Any]:
        """Create a future whose done callbacks this executor runs."""
        return Future(executor=self)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Run no more callbacks and release the nodes; always returns True."""
        self._is_shutdown = True
        with self._nodes_lock:
            self._nodes.clear()
            self._layout = None
        self._round.clear()
        self.notify()
        return True

    def add_node(self, node: NodeInterface) -> bool:
        """Run the callbacks of a node, which leaves its former executor.

        Returns False if the executor already has the node.
        """
        with self._nodes_lock:
            if node in self._nodes:
                return False
            self._nodes[node] = None
        self._layout = None
        node.executor = self
        self._unpark()
        self._sleep.end()
        return True

    def remove_node(self, node: NodeInterface) -> None:
        """Stop running the callbacks of a node."""
        with self._nodes_lock:
            self._nodes.pop(node, None)
            self._layout = None
        self._sleep.end()

    def get_nodes(self) -> list[NodeInterface]:
        """The nodes whose callbacks it runs."""
        with self._nodes_lock:
            return list(self._nodes)

    def has_node(self, node: NodeInterface) -> bool:
        """Whether it runs the callbacks of this node."""
        return node in self._nodes

    def wake(self) -> None:
        """Collect the entities of the nodes again: one was created or destroyed."""
        self._version = object()
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
        check_spin(self, future, timeout_sec)
        is_over = self._wake_for(future)
        end = None if timeout_sec is None or timeout_sec < 0 else time.perf_counter() + timeout_sec
        left = None if end is None else TimeoutObject(timeout_sec or 0)
        while not is_over() and self._context.ok() and not self._is_shutdown:
            self.spin_once_until_future_complete(future, left)
            if end is not None and left is not None:
                left.timeout = end - time.perf_counter()
                if left.timeout <= 0:
                    return

    def spin_once(self, timeout_sec: Timeout = None) -> None:
        """Wait at most `timeout_sec` seconds for something to arrive, and run one callback.

        None and a negative number wait without end; 0 does not wait.
        """
        raise NotImplementedError

    def spin_once_until_future_complete(
        self, future: Future[Any], timeout_sec: Timeout = None
    ) -> None:
        """Spin once, but stop waiting when the future is done."""
        raise NotImplementedError

    def wait_for_ready_callbacks(
        self,
        timeout_sec: Timeout = None,
        nodes: Sequence[NodeInterface] | None = None,
        condition: Callable[[], bool] = never,
    ) -> tuple[Task[Any], Entity | None, Any]:
        """Wait for work: returns a task to call, and the entity and the node that it comes from.

        Raises TimeoutException, ShutdownException or ConditionReachedException when there is none,
        and ExternalShutdownException when the context was shut down.
        """
        work = self._next(timeout_sec, nodes, condition)
        if work is None:
            if self._is_shutdown:
                raise ShutdownException
            raise ConditionReachedException if condition() else TimeoutException
        task, entity, node = work
        if task is None:
            if entity is not None:
                entity.is_scheduled = True  # no round may choose it before the task takes it
            task = Task(self._run_entity, (entity,), executor=self)
        return task, entity, node

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.shutdown()

    def _wait_for_ready_callbacks(
        self,
        timeout_sec: Timeout = None,
        nodes: Sequence[NodeInterface] | None = None,
        condition: Callable[[], bool] = never,
    ) -> Generator[tuple[Task[Any], Entity | None, Any], None, None]:
        """Yield the results of repeated calls of `wait_for_ready_callbacks`."""
        while True:
            yield self.wait_for_ready_callbacks(timeout_sec, nodes, condition)

    def _wake_for(self, future: Any) -> Callable[[], bool]:
        """Wake up when the future ends. Returns a function that tells whether it has ended.

        The future may be of another class, such as that of `concurrent.futures`.
        """
        if isinstance(future, Future):
            future.when_done(self.notify)
            return future.is_over
        future.add_done_callback(lambda _: self.notify())
        return lambda: bool(future.done() or future.cancelled())

    def _run(self, work: Work) -> None:
        """Run one piece of work to its end or its first `await`; raises its exception."""
        task, entity, _ = work
        if task is not None:
            self._run_task(task)
        elif entity is not None:
            self._run_entity(entity)

    def _run_entity(self, entity: Entity) -> None:
        group = entity.callback_group if self._respects_groups else None
        if group is not None and not group.beginning_execution(entity):
            entity.is_scheduled = False
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
            return entity.take_work()
        except InvalidHandle:  # another thread destroyed it
            return None
        finally:
            if entity.is_scheduled:  # the spinning thread of a pool may choose it again from now on
                entity.is_scheduled = False
                self.notify()

    def _begin_coroutine(self, coroutine: CoroutineType[Any, Any, Any], entity: Entity) -> bool:
        """Run the coroutine of a callback to its first `await`; returns whether it still waits."""
        task: Task[Any] = Task(coroutine, executor=self)
        task.entity, task.parent_node = entity, entity.parent_node
        self._keep(task)
        task()
        if raise_once(task):
            return False
        # The future that it awaits may be known to nobody else. Without this reference, the garbage
        # collector would end the coroutine, and the caller would get an error.
        self._waiting.add(task)
        task.when_done(lambda: self._coroutine_ended(entity, task))
        return True

    def _coroutine_ended(self, entity: Entity, task: Task[Any]) -> None:
        self._waiting.discard(task)
        if entity.callback_group is not None and self._respects_groups:
            entity.callback_group.ending_execution(entity)
        self.notify()

    def _run_task(self, task: Task[Any]) -> None:
        before = started(task.entity, self)
        try:
            task()
        finally:
            ended(before)
        raise_once(task)


class SingleThreadedExecutor(Executor):
    """Runs one callback after another on the thread that spins."""

    runs_one_at_a_time = True

    def spin_once(self, timeout_sec: Timeout = None) -> None:
        """Wait at most `timeout_sec` seconds for something to arrive, and run one callback."""
        if (work := self._next(timeout_sec)) is not None:
            self._run(work)
            if timeout_sec == 0 and work[1] is not None and work[1].is_service:
                settle()  # the response arrives now if the caller is this program

    def spin_once_until_future_complete(
        self, future: Future[Any], timeout_sec: Timeout = None
    ) -> None:
        """Spin once, but stop waiting when the future is done."""
        if (work := self._next(timeout_sec, None, self._wake_for(future))) is not None:
            self._run(work)


class MultiThreadedExecutor(Executor):
    """Runs callbacks in parallel in a pool of threads, as far as their groups allow."""

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
        self.runs_one_at_a_time = num_threads == 1
        self.thread_count = num_threads
        self._executor = ThreadPoolExecutor(num_threads)
        self._failures: deque[BaseException] = deque()
        """Exceptions of callbacks, which the next `spin_once` raises."""
        self._spinners: set[int] = set()
        """The threads that wait in `spin_once`, by identifier."""
        self._ended_spinners: set[int] = set()
        """The threads whose `spin_once` the shutdown has ended; the next one raises, so that a
        loop ends."""

    def spin_once(self, timeout_sec: Timeout = None) -> None:
        """Wait at most `timeout_sec` seconds for work, and give it to a thread of the pool.

        Raises the exception of a callback that an earlier call started.
        """
        self._spin_once(timeout_sec, never)

    def spin_once_until_future_complete(
        self, future: Future[Any], timeout_sec: Timeout = None
    ) -> None:
        """Spin once, but stop waiting when the future is done."""
        self._spin_once(timeout_sec, self._wake_for(future))

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Run no more callbacks and wait for the running ones, unless a callback calls this."""
        done = super().shutdown(timeout_sec)
        self._executor.shutdown(wait=wait_for_threads and current_callback() is None)
        return done

    @property
    def is_shutdown(self) -> bool:
        """Whether `shutdown` was called."""
        return self._is_shutdown

    @property
    def is_unattended(self) -> bool:
        """Whether no thread spins it; callbacks in its pool may still run."""
        return not self._spinners

    def _spin_once(self, timeout_sec: Timeout, condition: Callable[[], bool]) -> None:
        spinner = threading.get_ident()
        self._spinners.add(spinner)
        try:
            work = self._next(timeout_sec, None, lambda: bool(self._failures) or condition())
        except ExternalShutdownException:
            if spinner in self._ended_spinners:
                raise
            self._ended_spinners.add(spinner)
            return
        finally:
            self._spinners.discard(spinner)
        if self._failures:
            if work is not None:
                self._round.appendleft(work)
            raise self._failures.popleft()
        if work is not None:
            self._submit(work)

    def _submit(self, work: Work) -> None:
        if work[0] is None and work[1] is not None:
            work[1].is_scheduled = True
        try:
            self._executor.submit(self._work, work)
        except RuntimeError as error:
            if _POOL_ENDED not in str(error):
                raise
            # Another thread shut the pool down after the work was chosen, or the program is ending.
            self._is_shutdown = True

    def _work(self, work: Work) -> None:
        """Run one piece of work on a thread of the pool."""
        try:
            if not self._is_shutdown:
                self._run(work)
        except BaseException as error:
            self._failures.append(error)
        finally:
            self.notify()


_POOL_ENDED = "cannot schedule new futures"
"""The error of a pool that was shut down, or whose interpreter is ending."""


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
    "await_or_execute",
    "current_callback",
]
