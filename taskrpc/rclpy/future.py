"""What will be known later: the answer of a call, the result of a task."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ._impl.execution.running_callbacks import Callback, running

if TYPE_CHECKING:
    from .executors import Executor

T = TypeVar("T")


class Future(Generic[T]):
    """A result that may still have to come; it comes only while somebody spins.

    `result()` of one that is pending is None, and a cancelled one is not done: so it is in ROS.
    """

    def __init__(self, *, executor: Executor | None = None) -> None:
        self._done = False
        self._cancelled = False
        self._result: T | None = None
        self._exception: BaseException | None = None
        self._exception_fetched = True
        self._callbacks: list[Callable[[Any], Any]] = []
        self._waiters: list[Callable[[], object]] = []
        self._lock = threading.Lock()
        self._heeded = False
        self._awaited_by: Any = None
        self._asked: tuple[Callback | None, float] = (None, 0.0)
        self._executor: Callable[[], Executor | None] = _none
        if executor is not None:
            self._set_executor(executor)

    def __del__(self) -> None:
        if not getattr(self, "_exception_fetched", True):
            print(
                f"The following exception was never retrieved: {self._exception}", file=sys.stderr
            )

    def __await__(self) -> Generator[Any, None, T | None]:
        self._heeded = True
        while not self._done:
            if (step := running_steps.get(threading.get_ident())) is not None:
                step.awaited = self
                yield
            elif (loop := asyncio._get_running_loop()) is not None:
                yield from self._done_in(loop)
            else:  # whoever drives this coroutine asks again, as in ROS
                yield
        return self.result()

    def cancel(self) -> None:
        """Give it up, unless it is done; its done callbacks run."""
        with self._lock:
            if not self._done:
                self._cancelled = True
        self._schedule_or_invoke_done_callbacks()

    def cancelled(self) -> bool:
        """Whether it was given up, and nothing came later."""
        return self._cancelled

    def done(self) -> bool:
        """Whether a result or an exception is there."""
        self._heeded = True
        if not self._done:
            self._asked = running.get(threading.get_ident()), time.monotonic()
        return self._done

    def result(self) -> T | None:
        """The result; None while there is none. Raises the exception that came instead."""
        self._heeded = True
        if self._exception is not None:
            self._exception_fetched = True
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        """The exception that came instead of a result, if one did."""
        self._heeded = True
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
        """Have the callback called with this future once it is done (at once if it is).

        It runs on the executor's thread where there is an executor.
        """
        self._heeded = True
        with self._lock:
            if not self._done:
                self._callbacks.append(callback)
                return
        if (executor := self._executor()) is not None:
            executor.create_task(callback, self)
        else:
            callback(self)

    def remove_done_callback(self, callback: Callable[[Future[T]], Any]) -> bool:
        """Forget a done callback; whether there was such a one."""
        with self._lock:
            if callback not in self._callbacks:
                return False
            self._callbacks.remove(callback)
            return True

    def _is_over(self) -> bool:
        """Whether nobody need wait for it: it is done, or was given up."""
        return self._done or self._cancelled

    def _set_executor(self, executor: Executor | None) -> None:
        """Have the done callbacks run by this executor."""
        self._executor = _none if executor is None else weakref.ref(executor)

    def _when_done(self, waiter: Callable[[], object]) -> None:
        """Call the waiter on the thread that completes or cancels this, before done callbacks."""
        with self._lock:
            if not self._done:
                if waiter not in self._waiters:  # spinning again and again for one future
                    self._waiters.append(waiter)
                return
        waiter()

    def _done_in(self, loop: asyncio.AbstractEventLoop) -> Generator[Any, None, None]:
        """Wait in a coroutine of asyncio, while another thread spins."""
        done: asyncio.Future[None] = loop.create_future()

        def wake() -> None:
            if not done.done():
                done.set_result(None)

        def tell() -> None:
            with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
                loop.call_soon_threadsafe(wake)

        self._when_done(tell)
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
    """One step of a task's coroutine, which runs now."""

    awaited: Future[Any] | None = None
    """The future at which it stopped; None when it stopped for another reason."""


running_steps: dict[int, Step] = {}
"""The innermost step on each thread, by the thread's identifier."""

Future.__module__ = f"{__package__}.task"  # where programs find it


def _none() -> None:
    """Stand in for a reference to an executor where there is none."""
