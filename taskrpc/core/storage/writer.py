"""Group commit: changes that arrive together share one transaction, and one wait for the disk."""

from __future__ import annotations

import asyncio
import copy
import sqlite3
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for_jobs
from functools import partial
from typing import Any, Generic, TypeAlias, TypeVar

from taskrpc.core.storage.database import Database, MemoryDatabase
from taskrpc.core.storage.lock import FileInUse
from taskrpc.core.transport.chance import give_chance, is_seeded, present_chance
from taskrpc.errors import OutcomeUnknown, StoreError

_Change = TypeVar("_Change")
_Result = TypeVar("_Result")

NOTHING_STORED = "nothing was stored; the server's log says why"
"""The text that callers get if the error's own text may contain the service's SQL or code."""

_POLL_PERIOD = 0.05
"""Seconds between two attempts to lock the file; the system does not notify."""

_Opened: TypeAlias = Database | MemoryDatabase


class Writer(Generic[_Change]):
    """A file's one writer. Calls take effect in the order in which they are made.

    Everything happens in one thread of its own, so the event loop never waits for the disk. While
    that thread is busy, new changes collect; they are the next transaction. A caller that stops
    waiting does not stop its change.

    Args:
        open_file: opens the file, when it is first needed.
        write: writes changes in one transaction.
    """

    def __init__(
        self,
        open_file: Callable[[], _Opened],
        write: Callable[[Any, Sequence[_Change]], None],
    ) -> None:
        self._open_file = open_file
        self._write = write
        self._database: _Opened | None = None
        self._thread: ThreadPoolExecutor | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: deque[_PendingWork] = deque()
        self._is_busy = False
        """Whether the thread works, or will begin in the loop's next iteration."""
        self._waits = False
        """Whether the loop waits for the thread, so that each job ends at a fixed place of a run
        that can be repeated."""
        self.transactions: Counter[int] = Counter()
        """How many transactions there were, by the number of their changes."""

    def change(self, change: _Change) -> asyncio.Future[None]:
        """Write a change; the returned future is done once the change is on the disk.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: it may have been changed, and the file is broken until `close`.
        """
        return self._submit(change, None)

    async def change_alone(self, work: Callable[[sqlite3.Connection], None]) -> None:
        """Run a function in a transaction of its own; it is on the disk when this returns."""
        await self._submit(None, lambda: self._opened().change(work))

    async def read(self, work: Callable[[sqlite3.Connection], _Result]) -> _Result:
        """Return the result of a function that reads the file. Raises StoreError."""
        found: _Result = await self._submit(None, lambda: self._opened().read(work))
        return found

    def open_now(self, read: Callable[[sqlite3.Connection], object]) -> bool:
        """Open the file and try to read it, unless it is open; the event loop waits for that.

        Returns whether this opened it. Raises StoreError.
        """
        if self._database is not None:
            return False
        self._worker().submit(self._open_and_read, read).result()
        return True

    async def reopen(self) -> None:
        """Open the file; a broken file is closed and opened again. Raises StoreError."""
        await self._submit(None, self._reopen)

    async def claim(self, waiting: Callable[[FileInUse], object]) -> None:
        """Wait until no other process uses the file, then open it.

        If another process uses it, `waiting` is called once with the error that names the process.

        Raises StoreError.
        """
        is_reported = False
        while True:
            try:
                await self.reopen()
                return
            except FileInUse as error:
                if not is_reported:
                    is_reported = True
                    waiting(error)
            await asyncio.sleep(_POLL_PERIOD)

    async def close(self) -> None:
        """Finish all work, write everything into the one file and release it."""
        if self._thread is not None:
            await self._submit(None, self._close)
            self._thread.shutdown()
            self._thread = None

    # On the loop

    def _submit(
        self, change: _Change | None, alone: Callable[[], Any] | None
    ) -> asyncio.Future[Any]:
        loop = asyncio.get_running_loop()
        if self._loop is not loop:  # another asyncio.run: the previous one's callers have ended
            self._loop, self._is_busy, self._waits = loop, False, is_seeded(loop)
            self._waiting.clear()
        result = loop.create_future()
        self._waiting.append(_PendingWork(change, alone, result))
        if not self._is_busy:
            self._is_busy = True
            # Not at once: other changes of this iteration of the loop join the transaction.
            loop.call_soon(self._next, loop)
        return result

    def _next(self, loop: asyncio.AbstractEventLoop) -> None:
        waiting = self._waiting
        if not waiting:
            self._is_busy = False
            return
        taken = [waiting.popleft()]
        if (alone := taken[0].alone) is not None:
            job: Callable[[], list[Any]] = partial(_outcome, alone)
        else:
            while waiting and waiting[0].alone is None:
                taken.append(waiting.popleft())
            job = partial(self._change_all, [each.change for each in taken])
            self.transactions[len(taken)] += 1
        if self._waits:
            running = asyncio.wrap_future(_ended(self._worker().submit(job)), loop=loop)
        else:
            running = loop.run_in_executor(self._worker(), job)
        running.add_done_callback(partial(self._done, loop, taken))

    def _worker(self) -> ThreadPoolExecutor:
        if self._thread is None:
            self._thread = ThreadPoolExecutor(
                1, "taskrpc-store", initializer=give_chance, initargs=(present_chance(),)
            )
        return self._thread

    def _done(
        self,
        loop: asyncio.AbstractEventLoop,
        taken: list[_PendingWork],
        running: asyncio.Future[list[Any]],
    ) -> None:
        self._next(loop)  # first, so that the thread works on while callers get results
        for work, outcome in zip(taken, running.result(), strict=True):
            if work.result.done():
                continue
            if isinstance(outcome, Exception):
                work.result.set_exception(outcome)
            else:
                work.result.set_result(outcome)

    # In the thread

    def _opened(self) -> _Opened:
        if self._database is None:
            self._database = self._open_file()
        return self._database

    def _open_and_read(self, read: Callable[[sqlite3.Connection], object]) -> None:
        try:
            self._opened().read(read)
        except BaseException:
            self._close()
            raise

    def _reopen(self) -> None:
        if self._database is not None and self._database.is_broken:
            self._close()
        self._opened()

    def _close(self) -> None:
        database, self._database = self._database, None
        if database is not None:
            database.close()

    def _change_all(self, changes: list[_Change]) -> list[Exception | None]:
        """Return the result of each change: None if it is stored, else the error."""
        count = len(changes)
        try:
            self._write(self._opened(), changes)
        except (StoreError, OutcomeUnknown) as error:
            return [copy.copy(error) for _ in changes]
        except Exception as error:
            if count == 1:
                return [_refusal(error)]
            # One of the changes cannot be written: find it, and write the others.
            first, rest = changes[: count // 2], changes[count // 2 :]
            return self._change_all(first) + self._change_all(rest)
        return [None] * count


class _PendingWork:
    """Work with a waiting caller: a change, or work that is done alone."""

    __slots__ = ("alone", "change", "result")

    def __init__(
        self, change: Any, alone: Callable[[], Any] | None, result: asyncio.Future[Any]
    ) -> None:
        self.change, self.alone, self.result = change, alone, result


def _ended(job: Future[_Result]) -> Future[_Result]:
    """Return the job once it has ended."""
    wait_for_jobs([job])
    return job


def _outcome(work: Callable[[], Any]) -> list[Any]:
    try:
        return [work()]
    except (StoreError, OutcomeUnknown) as error:
        return [error]
    except Exception as error:
        return [_refusal(error)]


def _refusal(error: Exception) -> StoreError:
    refusal = StoreError(f"nothing was stored: {error}")
    refusal.for_callers = NOTHING_STORED
    refusal.__cause__ = error
    return refusal
