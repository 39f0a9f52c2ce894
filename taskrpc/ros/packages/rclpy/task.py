"""Futures, and the functions and coroutines that an executor runs step by step."""

from __future__ import annotations

import asyncio
import contextlib
import enum
import inspect
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Generator, Iterable, Mapping
from types import CoroutineType
from typing import Any, Generic, TypeVar

from ._impl.execution.entity import Callback, Entity, ExecutorInterface, running

T = TypeVar("T")


class FutureState(enum.Enum):
    """The states of a future."""

    PENDING = "PENDING"
    CANCELLED = "CANCELLED"
    FINISHED = "FINISHED"


class Future(Generic[T]):
    """A result that may not be known yet; it becomes known only while a thread spins the node.

    As in ROS, `result()` of a pending future is None, and a cancelled future is not done.
    """

    def __init__(self, *, executor: ExecutorInterface | None = None) -> None:
        self._done = False
        self._cancelled = False
        self._result: T | None = None
        self._exception: BaseException | None = None
        self._exception_fetched = True
        """False while it has an exception that the program has not read."""
        self._callbacks: list[Callable[[Any], Any]] = []
        self._waiters: list[Callable[[], object]] = []
        """Functions of rclpy itself (`when_done`), which run before the done callbacks."""
        self._lock = threading.Lock()
        self.is_observed = False
        """Whether the program ever read its result, for the watchdog."""
        self.awaited_by: Any = None
        """The task that awaits it, for the watchdog."""
        self.last_poll: tuple[Callback | None, float] = (None, 0.0)
        """The callback that last polled it while it was pending, and when."""
        self._executor: Callable[[], ExecutorInterface | None] = _none
        if executor is not None:
            set_executor(self, executor)

    def __del__(self) -> None:
        if not getattr(self, "_exception_fetched", True):
            print(
                f"The following exception was never retrieved: {self._exception}", file=sys.stderr
            )

    def __await__(self) -> Generator[Any, None, T | None]:
        self.is_observed = True
        while not self._done:
            if (step := running_steps.get(threading.get_ident())) is not None:
                step.awaited = self
                yield
            elif (loop := asyncio._get_running_loop()) is not None:
                yield from self._done_in(loop)
            else:  # as in ROS, the code that drives this coroutine polls
                yield
        return self.result()

    def cancel(self) -> None:
        """Cancel it, unless it is done; its done callbacks run."""
        with self._lock:
            if not self._done:
                self._cancelled = True
        self._schedule_or_invoke_done_callbacks()

    def cancelled(self) -> bool:
        """Whether it was cancelled and has not been completed since."""
        return self._cancelled

    def done(self) -> bool:
        """Whether it has a result or an exception."""
        self.is_observed = True
        if not self._done:
            self.last_poll = running.get(threading.get_ident()), time.monotonic()
        return self._done

    @property
    def _state(self) -> FutureState:
        """Its state; a few programs read it by this name."""
        if self._done:
            return FutureState.FINISHED
        return FutureState.CANCELLED if self._cancelled else FutureState.PENDING

    def result(self) -> T | None:
        """The result; None while it is pending. Raises the exception if it has one."""
        self.is_observed = True
        if self._exception is not None:
            self._exception_fetched = True
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        """The exception, if it has one."""
        self.is_observed = True
        self._exception_fetched = True
        return self._exception

    def set_result(self, result: T) -> None:
        """Complete it with a result."""
        with self._lock:
            self._result = result
            self._done = True
            self._cancelled = False
        self._schedule_or_invoke_done_callbacks()

    def set_exception(self, exception: BaseException) -> None:
        """Complete it with an exception, which `result()` raises."""
        with self._lock:
            self._exception = exception
            self._exception_fetched = False
            self._done = True
            self._cancelled = False
        self._schedule_or_invoke_done_callbacks()

    def add_done_callback(self, callback: Callable[[Future[T]], Any]) -> None:
        """Call the callback with this future when it is done; at once if it is done already.

        If the future has an executor, the callback runs on the thread that spins it.
        """
        self.is_observed = True
        with self._lock:
            if not self._done:
                self._callbacks.append(callback)
                return
        if (executor := self._executor()) is not None:
            executor.create_task(callback, self)
        else:
            callback(self)

    def remove_done_callback(self, callback: Callable[[Future[T]], Any]) -> bool:
        """Remove a done callback; returns whether it was there."""
        with self._lock:
            if callback not in self._callbacks:
                return False
            self._callbacks.remove(callback)
            return True

    def is_over(self) -> bool:
        """Whether it is done or cancelled."""
        return self._done or self._cancelled

    def when_done(self, waiter: Callable[[], object]) -> None:
        """Call the waiter before the done callbacks, on the thread that completes it."""
        with self._lock:
            if not self._done:
                if waiter not in self._waiters:  # a program may spin repeatedly for one future
                    self._waiters.append(waiter)
                return
        waiter()

    def _done_in(self, loop: asyncio.AbstractEventLoop) -> Generator[Any, None, None]:
        """Await it in a coroutine of asyncio, while another thread spins the node."""
        done: asyncio.Future[None] = loop.create_future()

        def wake() -> None:
            if not done.done():
                done.set_result(None)

        def tell() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(wake)

        self.when_done(tell)
        yield from done

    def _schedule_or_invoke_done_callbacks(self) -> None:
        with self._lock:
            waiters, self._waiters = self._waiters, []
            callbacks, self._callbacks = self._callbacks, []
        for waiter in waiters:
            waiter()
        if not callbacks:
            return
        executor = self._executor()
        for callback in callbacks:
            if executor is not None:
                executor.create_task(callback, self)
                continue
            try:
                callback(self)
            except Exception as error:
                warnings.warn(f"Unhandled exception in done callback: {error}", stacklevel=3)


class Step:
    """A running step of the coroutine of a task."""

    awaited: Future[Any] | None = None
    """The future that it awaits; None when it stopped for another reason."""


running_steps: dict[int, Step] = {}
"""The innermost step on each thread, by the thread's identifier."""


def _none() -> None:
    """Replace the weak reference while the future has no executor."""


class Task(Future[T]):
    """A function or coroutine function that runs when the task is called.

    A coroutine runs until it awaits something that is not done; the next call continues there.
    Executors create tasks (`create_task`) and call them.
    """

    def __init__(
        self,
        handler: Callable[..., Any] | CoroutineType[Any, Any, T],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        executor: ExecutorInterface | None = None,
    ) -> None:
        super().__init__(executor=executor)
        args = () if args is None else tuple(args)
        kwargs = {} if kwargs is None else dict(kwargs)
        if type(handler) is not CoroutineType and inspect.iscoroutinefunction(handler):
            handler, args, kwargs = handler(*args, **kwargs), (), {}
        self._handler: Any = handler
        self._args = args
        self._kwargs = kwargs
        self._executing = False
        self._task_lock = threading.Lock()
        self.entity: Entity | None = None
        self.parent_node: Any = None
        self.number = 0
        """Counts the tasks of an executor in the order of their creation."""
        self._raised = False
        """Whether `raise_once` has raised the exception of this task."""

    def __call__(self) -> None:
        """Run the function or the next step of the coroutine; an exception completes the task."""
        if self._done or not self._task_lock.acquire(blocking=False):
            return
        awaited: Any = self
        try:
            self._executing = True
            if type(self._handler) is CoroutineType:
                awaited = self._step(self._handler)
            elif self._handler is not None:  # else another thread has just finished it
                self._finish(self._handler)
        finally:
            self._executing = False
            self._task_lock.release()
        if awaited is not self:  # after the release: another thread may call it at once
            self._await(awaited)

    def executing(self) -> bool:
        """Whether it is running now, on any thread."""
        return self._executing

    def is_runnable(self) -> bool:
        """Whether it has a next step; closes the coroutine of a cancelled task."""
        if self._cancelled and type(self._handler) is CoroutineType:
            self._handler.close()
        return not self._done and not self._cancelled

    def _step(self, coroutine: CoroutineType[Any, Any, T]) -> Any:
        """Run a step; returns the awaited future, or this task itself at the end."""
        thread, step = threading.get_ident(), Step()
        outer = running_steps.get(thread)
        running_steps[thread] = step
        try:
            coroutine.send(None)
            return step.awaited
        except StopIteration as stop:
            self._forget()
            self.set_result(stop.value)
        except Exception as error:
            self._forget()
            self.set_exception(error)
        finally:
            if outer is None:
                del running_steps[thread]
            else:
                running_steps[thread] = outer
        return self

    def _finish(self, function: Callable[..., T]) -> None:
        args, kwargs = self._args, self._kwargs
        try:
            result = function(*args, **kwargs)
        except Exception as error:
            self._forget()
            self.set_exception(error)
        else:
            self._forget()
            self.set_result(result)

    def _await(self, awaited: Any) -> None:
        """Let the executor call this task again when the awaited future is done."""
        executor = self._executor()
        if executor is None:
            return
        if awaited is not None:
            awaited.awaited_by = self
            awaited.when_done(lambda: executor.resume_task(self))
        else:  # a bare yield: the next round
            executor.resume_task(self)

    def _forget(self) -> None:
        """Release the function and its arguments, which may keep other objects alive."""
        self._handler, self._args, self._kwargs = None, (), {}


def raise_once(task: Task[Any]) -> bool:
    """Whether a task has ended. Raises its exception, but only once.

    Several threads may see that the task has ended; only one of them must raise.
    """
    if not task._done:
        return False
    if (error := task.exception()) is not None:
        with task._lock:
            is_first, task._raised = not task._raised, True
        if is_first:
            raise error
    return True


def set_executor(future: Future[Any], executor: ExecutorInterface | None) -> None:
    """Let this executor run the done callbacks of a future."""
    future._executor = _none if executor is None else weakref.ref(executor)


__all__ = ["Future", "Task"]
