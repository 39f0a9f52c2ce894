"""Threads as stacks, of which one runs at a time: what takes the place of Python's own threads.

Python's `threading` is built from a few names: locks, handles of threads, and the number of the
running thread. `replace_threads` exchanges them, so that programs, the standard library, taskrpc
and rclpy use stacks as they are. A `Scheduler` knows how to suspend a stack.
"""

from __future__ import annotations

import _thread
import _threading_local
import queue
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Any, Final, Protocol

_HAS_HANDLES: Final = sys.version_info >= (3, 13)
"""Whether `threading` starts a thread with a handle, instead of a lock that its end releases."""


class Waiter(Protocol):
    """One wait of one stack; it ends once."""

    reason: object
    """What the stack waits for, if that is a lock; else None."""

    def wake(self, *, granted: bool) -> bool:
        """End the wait; returns False if it has ended already.

        `granted`: the stack got what it waited for, rather than a timeout or an interrupt.
        """


class Scheduler(Protocol):
    """Decides which stack runs."""

    def get_ident(self) -> int:
        """Return the number of the running stack."""

    def start(self, run: Callable[[], object], handle: Handle) -> None:
        """Start a stack; sets the handle's `ident` now, and calls its `end` when `run` returns."""

    def wait(self, begin: Callable[[Waiter], object], timeout: float | None) -> bool:
        """Suspend the running stack until the waiter that `begin` gets is woken.

        Ends after `timeout` seconds, too. Returns whether it was granted.
        """

    def let_others_run(self) -> None:
        """Suspend the running stack for a moment, if it is the turn of others."""

    def sleep(self, seconds: float) -> None:
        """Take the place of `time.sleep`."""


_scheduler: Scheduler


class Lock:
    """A lock; the stack that releases it hands it to the one that has waited longest."""

    def __init__(self) -> None:
        self._locked = False
        self._waiters: deque[Waiter] = deque()
        self.owner = 0
        """The number of the stack that took it last."""

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Take the lock; returns False after the timeout, or at once if not `blocking`."""
        _scheduler.let_others_run()
        if not self._locked:
            self._locked = True
            self.owner = _scheduler.get_ident()
            return True
        if not blocking or timeout == 0:
            return False
        if _scheduler.wait(self._begin_wait, None if timeout < 0 else timeout):
            self.owner = _scheduler.get_ident()
            return True
        return False

    def _begin_wait(self, waiter: Waiter) -> None:
        waiter.reason = self
        self._waiters.append(waiter)

    def release(self) -> None:
        """Free the lock."""
        if not self._locked:
            raise RuntimeError("release unlocked lock")
        while self._waiters:
            if self._waiters.popleft().wake(granted=True):
                return  # the lock stays locked, for that stack
        self._locked = False

    def locked(self) -> bool:
        """Whether a stack has it."""
        return self._locked

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        self.release()

    def _at_fork_reinit(self) -> None:
        self._locked = False
        self._waiters.clear()


class Handle:
    """What a `threading.Thread` knows of its stack."""

    def __init__(self) -> None:
        self.ident: int | None = None
        self.released_at_end: Lock | None = None
        """The lock that tells `threading` of Python 3.12 and older that the thread has ended."""
        self._is_done = False
        self._waiters: list[Waiter] = []

    def is_done(self) -> bool:
        """Whether the thread has ended."""
        return self._is_done

    def join(self, timeout: float | None = None) -> None:
        """Wait for its end."""
        if not self._is_done:
            endless = timeout is None or timeout < 0
            _scheduler.wait(self._waiters.append, None if endless else timeout)

    def end(self) -> None:
        """Wake those who wait for the end."""
        self._is_done = True
        if self.released_at_end is not None and self.released_at_end.locked():
            self.released_at_end.release()
        for waiter in self._waiters:
            waiter.wake(granted=True)

    def _set_done(self) -> None:
        self.end()


def replace_threads(
    scheduler: Scheduler, present: Callable[[], Handle | None] = lambda: None
) -> None:
    """Let all threads of this interpreter be stacks of a scheduler from now on.

    Call it once, before the modules that use threads are imported. `present` returns the handle of
    the running stack; only Python 3.12 and older need it.
    """
    global _scheduler
    _scheduler = scheduler

    def sentinel() -> Lock:
        lock = Lock()
        if (handle := present()) is not None:
            handle.released_at_end = lock
        return lock

    replaced: dict[Any, dict[str, Any]] = {
        threading: {
            "Lock": Lock,
            "_allocate_lock": Lock,
            "RLock": getattr(threading, "_PyRLock"),  # noqa: B009
            "_CRLock": None,
            "get_ident": scheduler.get_ident,
            "get_native_id": scheduler.get_ident,
            "local": _threading_local.local,
        },
        _thread: {
            "get_ident": scheduler.get_ident,
            "get_native_id": scheduler.get_ident,
            "allocate_lock": Lock,
            "RLock": getattr(threading, "_PyRLock"),  # noqa: B009
            "start_new_thread": _start_new_thread,
            "_local": _threading_local.local,
        },
        queue: {"SimpleQueue": getattr(queue, "_PySimpleQueue")},  # noqa: B009
        time: {"sleep": scheduler.sleep},
    }
    if _HAS_HANDLES:
        replaced[threading] |= {
            "_ThreadHandle": Handle,
            "_start_joinable_thread": _start_joinable_thread,
        }
    else:
        replaced[threading] |= {
            "_start_new_thread": _start_new_thread,
            "_set_sentinel": sentinel,
        }
    for module, names in replaced.items():
        for name, value in names.items():
            setattr(module, name, value)


def _start_joinable_thread(
    function: Callable[[], object], handle: Handle | None = None, daemon: bool = True
) -> Handle:
    handle = Handle() if handle is None else handle
    _scheduler.start(function, handle)
    return handle


def _start_new_thread(
    function: Callable[..., object], arguments: tuple[Any, ...], named: dict[str, Any] | None = None
) -> int:
    handle = Handle()
    _scheduler.start(lambda: function(*arguments, **(named or {})), handle)
    assert handle.ident is not None
    return handle.ident
