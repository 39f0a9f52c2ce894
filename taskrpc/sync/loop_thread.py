"""The event loop of blocking programs, in a thread of its own."""

from __future__ import annotations

import asyncio
import atexit
import os
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from concurrent.futures import TimeoutError as WaitTimeout
from typing import Any, TypeVar

from taskrpc.errors import WouldDeadlock
from taskrpc.program import fast_loop

_Result = TypeVar("_Result")

SLICE = 0.1
"""Seconds of one wait on a lock: on Windows, Ctrl-C does not interrupt a wait on a lock."""

_ENDED = 0
"""Takes the place of the process id once the loop is stopping."""


class LoopThread:
    """The event loop of this process's blocking nodes, in a thread of its own."""

    _instance: LoopThread | None = None
    _guard = threading.Lock()

    def __init__(self) -> None:
        self._started: Future[asyncio.AbstractEventLoop] = Future()
        self._thread = threading.Thread(target=self._main, name="taskrpc", daemon=True)
        self._thread.start()
        self._loop = self._started.result()
        self._pid = os.getpid()
        atexit.register(self._stop)

    @classmethod
    def shared(cls) -> LoopThread:
        """Return the process's loop thread; the first call, also after a fork, starts it."""
        with cls._guard:
            if cls._instance is None or cls._instance._pid != os.getpid():
                cls._instance = cls()
            return cls._instance

    @property
    def event_loop(self) -> asyncio.AbstractEventLoop:
        """The event loop; only its `*_threadsafe` methods are for other threads."""
        return self._loop

    def run(self, coroutine: Coroutine[Any, Any, _Result], what: str) -> _Result:
        """Run a coroutine on the loop and wait for its result."""
        try:
            self.refuse_own_thread(what)
        except WouldDeadlock:
            coroutine.close()
            raise
        return wait(asyncio.run_coroutine_threadsafe(coroutine, self._loop))

    def do(self, action: Callable[[], _Result], what: str) -> _Result:
        """Run a plain function on the loop and wait for its result."""

        async def run() -> _Result:
            return action()

        return self.run(run(), what)

    def soon(self, action: Callable[[], object]) -> None:
        """Run a plain function on the loop without waiting."""
        self._loop.call_soon_threadsafe(action)

    def settle(self, turns: int, patience: float) -> None:
        """Wait until the loop has made so many iterations, at most `patience` seconds.

        Messages between nodes of this process have then arrived.
        """
        done = threading.Lock()
        done.acquire()

        def turn(left: int) -> None:
            if left:
                self._loop.call_soon(turn, left - 1)
            else:
                done.release()

        if self._pid == os.getpid() and threading.current_thread() is not self._thread:
            self._loop.call_soon_threadsafe(turn, turns)
            done.acquire(timeout=patience)

    def refuse_without_loop(self, what: str) -> None:
        """Raise WouldDeadlock if no loop runs: after a fork, and at the program's end."""
        if self._pid == _ENDED:
            raise WouldDeadlock(
                f"{what} would wait for ever: the program is ending, its event loop has stopped;"
                " register functions with atexit only after the first node was made"
            )
        if self._pid != os.getpid():
            raise WouldDeadlock(f"{what}: this node belongs to the parent process; make one here")

    def refuse_own_thread(self, what: str) -> None:
        """Raise WouldDeadlock on the loop's own thread, which would wait for itself."""
        if self._pid != os.getpid():  # compare here: every call uses this method
            self.refuse_without_loop(what)
        if threading.current_thread() is self._thread:
            raise WouldDeadlock(
                f"{what} would wait for ever: it was called on the event loop's own thread, by an"
                " async callback or one with threaded=False; use a plain callback, which runs in"
                " a thread, or taskrpc.Node with `await`"
            )

    def _main(self) -> None:
        with asyncio.Runner(loop_factory=fast_loop()) as runner:
            loop = runner.get_loop()
            self._started.set_result(loop)
            loop.run_forever()

    def _stop(self) -> None:
        if self._pid == os.getpid():
            self._pid = _ENDED
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(2.0)


def wait(future: Future[_Result]) -> _Result:
    """Wait for a future's result; if Ctrl-C interrupts the wait, cancel the future."""
    try:
        while True:
            try:
                return future.result(SLICE)
            except WaitTimeout:
                # Our own DeadlineExceeded is a TimeoutError too; only an unfinished wait goes on.
                if future.done():
                    return future.result()
    except (KeyboardInterrupt, SystemExit):
        future.cancel()
        raise
