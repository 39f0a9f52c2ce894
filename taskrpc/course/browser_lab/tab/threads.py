"""Threads in a browser tab: each is a stack of its own, and one of them runs at a time.

Pyodide has no threads. With WebAssembly's stack switching (JSPI), Python can wait for a promise in
the middle of any function while other stacks and the event loop run. `install` replaces what
`threading` is made of, as in a simulation, so that programs, taskrpc and rclpy use its threads,
locks and events as they are. A thread runs until it waits; a program that never waits stops the
tab's worker.
"""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from collections.abc import Callable
from contextvars import copy_context
from typing import Any, Final

from taskrpc.errors import TaskRpcError, WouldDeadlock
from taskrpc.simulation.interpreter.threads import Handle, replace_threads
from taskrpc.spi import current_program

TIME_SLICE: Final = 0.02
"""Seconds after which a thread that never waits lets others run, when it takes a lock."""

_FIRST_IDENT = 1000

_COLLECTION = 5.0  # seconds between two collections of unreachable objects


class CannotWait(TaskRpcError):
    """A plain function wants to wait, and the browser cannot switch stacks."""

    def __init__(self) -> None:
        super().__init__(
            "this browser cannot wait inside a plain function, as rclpy does: it lacks stack"
            " switching for WebAssembly (JSPI); choose the asynchronous version above the editor,"
            " or open this page in Chrome, Edge or Chromium 137 or later"
        )


class Stack:
    """One thread of the tab."""

    def __init__(self, ident: int, program: str) -> None:
        self.ident = ident
        self.program = program
        self.waiter: Waiter | None = None
        """The wait that it is in; None while it runs."""
        self.interrupt: BaseException | None = None
        """Is raised where the thread waits."""


class Waiter:
    """One wait of one thread; it ends once, by `wake`."""

    def __init__(self, promise: Any) -> None:
        self.promise = promise
        self.reason: object = None
        self.is_over = False
        self.is_granted = False
        """Whether it got what it waited for, rather than a timeout or an interrupt."""

    def wake(self, *, granted: bool) -> bool:
        """End the wait; returns False if it has ended already."""
        if self.is_over:
            return False
        self.is_over, self.is_granted = True, granted
        self.promise.resolve()
        return True


class Scheduler:
    """The threads of a tab, and which one runs.

    Args:
        loop: the browser's event loop.
        new_promise: makes an object with `promise` and `resolve`.
        suspend: waits for a promise while other stacks run; None if the browser cannot.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        new_promise: Callable[[], Any],
        suspend: Callable[[Any], object] | None,
    ) -> None:
        self.loop = loop
        self._new_promise = new_promise
        self._suspend = suspend
        self._main = Stack(threading.main_thread().ident or 0, "")
        self._current = self._main
        self._stacks: dict[int, Stack] = {}
        self._last_ident = _FIRST_IDENT
        self._slice_ends = 0.0

    @property
    def can_wait(self) -> bool:
        """Whether the browser can switch stacks."""
        return self._suspend is not None

    def get_ident(self) -> int:
        """The number of the running thread; the event loop has that of the main thread."""
        return self._current.ident

    def start(self, run: Callable[[], object], handle: Handle) -> None:
        """Start a thread, in a copy of the caller's context."""
        self._last_ident += 1
        handle.ident = self._last_ident
        stack = self._stacks[handle.ident] = Stack(handle.ident, current_program.get())
        self.loop.call_soon(self._run, stack, run, handle, context=copy_context())

    def idents(self, program: str) -> list[int]:
        """The threads of a program, the oldest first."""
        return [stack.ident for stack in self._stacks.values() if stack.program == program]

    def interrupt(self, ident: int, error: BaseException) -> None:
        """Raise an exception in a thread, where it waits now or will wait next."""
        if (stack := self._stacks.get(ident)) is not None:
            stack.interrupt = error
            if stack.waiter is not None:
                stack.waiter.wake(granted=False)

    def wait(self, begin: Callable[[Waiter], object], timeout: float | None) -> bool:
        """Let others run until the waiter that `begin` gets is woken, or for `timeout` seconds.

        Returns whether it was woken. Raises CannotWait, and the exception of `interrupt`.
        """
        if self._suspend is None:
            raise CannotWait
        if self._current is self._main:
            return self._block_the_loop(timeout)
        me, waiter = self._current, Waiter(self._new_promise())
        begin(waiter)
        timer = None
        if timeout is not None:
            timer = self.loop.call_later(timeout, lambda: waiter.wake(granted=False))
        me.waiter = waiter
        if me.interrupt is not None:
            waiter.wake(granted=False)
        self._enter(self._main)
        try:
            self._suspend(waiter.promise.promise)
        finally:
            self._enter(me)
            me.waiter = None
            if timer is not None:
                timer.cancel()
        if me.interrupt is not None and not waiter.is_granted:
            error, me.interrupt = me.interrupt, None
            raise error
        return waiter.is_granted

    def sleep(self, seconds: float) -> None:
        """Let others run for some time; takes the place of `time.sleep`."""
        if seconds < 0:
            raise ValueError("sleep length must be non-negative")
        self.wait(lambda _: None, seconds)

    def let_others_run(self) -> None:
        """Let others run if this thread has run for a while."""
        if (
            self._current is not self._main
            and time.monotonic() > self._slice_ends
            and self._suspend
        ):
            self.sleep(0)

    def _block_the_loop(self, timeout: float | None) -> bool:
        """Do as an event loop does in which a callback waits: all that it serves stands still."""
        if timeout is None:
            raise WouldDeadlock(
                "this would wait for ever: it was called on the event loop, by an async callback;"
                " use `await`, or a plain callback"
            )
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            pass
        return False

    def _run(self, stack: Stack, run: Callable[[], object], handle: Handle) -> None:
        self._enter(stack)
        try:
            run()
        finally:
            self._enter(self._main)
            del self._stacks[stack.ident]
            handle.end()

    def _enter(self, stack: Stack) -> None:
        self._current = stack
        # Only the loop's own callbacks are inside a running loop.
        asyncio._set_running_loop(self.loop if stack is self._main else None)
        self._slice_ends = time.monotonic() + TIME_SLICE


def install() -> Scheduler:
    """Replace the threads of Pyodide's interpreter by stacks on its running event loop.

    Call it once, before programs start.
    """
    from js import Promise
    from pyodide.ffi import can_run_sync, run_sync

    suspend = run_sync if can_run_sync() else None
    scheduler = Scheduler(asyncio.get_running_loop(), Promise.withResolvers, suspend)
    replace_threads(scheduler)
    # An automatic collection looks at the frames of stacks that wait, whose memory another stack
    # may use by now; that ends Pyodide (its issue 6464). A full collection does not look at them.
    gc.disable()
    _collect(scheduler.loop)
    return scheduler


def _collect(loop: asyncio.AbstractEventLoop) -> None:
    gc.collect()
    loop.call_later(_COLLECTION, _collect, loop)
