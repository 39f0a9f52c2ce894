"""Tasks in an SQLite file: what was acknowledged is on the disk."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import TypeVar

import msgspec

from taskrpc import platform
from taskrpc.tasks.model import Task
from taskrpc.tasks.store import Stored, StoreError

FORMAT = 1
"""The version of the file's layout, kept in `PRAGMA user_version`."""
_APPLICATION_ID = 0x54525043  # "TRPC"; tells our files from other programs' databases

_LAYOUT = f"""
    BEGIN IMMEDIATE;
    CREATE TABLE task (task_id INTEGER PRIMARY KEY, record TEXT NOT NULL);
    CREATE TABLE server (next_id INTEGER NOT NULL, paused INTEGER NOT NULL);
    INSERT INTO server VALUES (1, 0);
    PRAGMA application_id = {_APPLICATION_ID};
    PRAGMA user_version = {FORMAT};
    COMMIT;
"""
# One statement a batch: each step of a statement takes the interpreter's lock from the event loop.
_SAVE = """
    INSERT OR REPLACE INTO task (task_id, record)
    SELECT json_extract(value, '$.task_id'), value FROM json_each(?)
"""
_FORGET = "DELETE FROM task WHERE task_id IN (SELECT value FROM json_each(?))"
_COUNT = "UPDATE server SET next_id = max(next_id, ?)"

_Result = TypeVar("_Result")


class SqliteStore:
    """A `TaskStore` in one file, which it keeps for itself from the first use until `close`.

    Everything happens in one thread of its own, in the order of the calls, so the event loop never
    waits for the disk.

    Args:
        path: the database file; made if it is not there. A file `<path>.lock` beside it says
            which server uses it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path).absolute()
        self._thread: ThreadPoolExecutor | None = None
        self._open_file: _TaskFile | None = None

    async def load(self) -> Stored:
        """Return everything that is remembered; see `TaskStore.load`."""
        return await self._do(lambda file: file.load())

    async def apply(self, saved: Sequence[Task], forgotten: Sequence[int] = ()) -> None:
        """Remember and forget in one transaction, on disk when it returns."""
        # Encoded here: the thread would only take turns with the loop for it.
        records = msgspec.json.encode(saved)
        newest = max((task.task_id for task in saved), default=0)
        numbers = msgspec.json.encode(forgotten)
        await self._do(lambda file: file.apply(records, newest, numbers))

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue stands still, on disk when it returns."""
        await self._do(lambda file: file.remember_pause(paused))

    async def clear(self) -> None:
        """Forget everything and begin again with number 1."""
        await self._do(lambda file: file.clear())

    async def close(self) -> None:
        """Write everything into the one file and let others use it."""
        thread, self._thread = self._thread, None
        if thread is not None:
            await asyncio.get_running_loop().run_in_executor(thread, self._close)
            thread.shutdown()

    async def _do(self, work: Callable[[_TaskFile], _Result]) -> _Result:
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="taskrpc-store")
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, self._in_thread, work)

    def _in_thread(self, work: Callable[[_TaskFile], _Result]) -> _Result:
        with _said_plainly(self._path):
            if self._open_file is None:
                self._open_file = _TaskFile(self._path)
            return work(self._open_file)

    def _close(self) -> None:
        if self._open_file is not None:
            self._open_file.close()
            self._open_file = None


class _TaskFile:
    """The open file with its lock; every call from one thread."""

    def __init__(self, path: Path) -> None:
        with contextlib.ExitStack() as undo:
            undo.enter_context(_held(path))
            self._connection = sqlite3.connect(path, isolation_level=None)
            undo.callback(self._connection.close)
            self._prepare(path)
            self._undo = undo.pop_all()

    def load(self) -> Stored:
        rows = self._connection.execute("SELECT record FROM task ORDER BY task_id").fetchall()
        next_id, paused = self._connection.execute("SELECT next_id, paused FROM server").fetchone()
        records = "[" + ",".join(row[0] for row in rows) + "]"
        tasks = msgspec.json.decode(records, type=tuple[Task, ...])
        return Stored(tasks, next_id, bool(paused))

    def apply(self, records: bytes, newest: int, forgotten: bytes) -> None:
        with self._transaction() as connection:
            connection.execute(_SAVE, (records.decode(),))
            connection.execute(_COUNT, (newest + 1,))
            if forgotten != b"[]":
                connection.execute(_FORGET, (forgotten.decode(),))

    def remember_pause(self, paused: bool) -> None:
        with self._transaction() as connection:
            connection.execute("UPDATE server SET paused = ?", (paused,))

    def clear(self) -> None:
        with self._transaction() as connection:
            connection.execute("DELETE FROM task")
            connection.execute("UPDATE server SET next_id = 1, paused = 0")

    def close(self) -> None:
        self._undo.close()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield self._connection
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise

    def _prepare(self, path: Path) -> None:
        if self._pragma("application_id") == 0 and not self._has_tables():
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.executescript(_LAYOUT)
        if self._pragma("application_id") != _APPLICATION_ID:
            raise StoreError(f"{path}: expected a task database, found another program's database")
        version = self._pragma("user_version")
        if version != FORMAT:
            raise StoreError(
                f"{path}: expected a task database of format {FORMAT}, found format {version}; "
                "use the taskrpc that wrote it, or another file"
            )
        self._connection.execute("PRAGMA journal_mode = WAL")
        self._connection.execute("PRAGMA synchronous = FULL")

    def _pragma(self, name: str) -> int:
        value: int = self._connection.execute(f"PRAGMA {name}").fetchone()[0]
        return value

    def _has_tables(self) -> bool:
        return self._connection.execute("SELECT 1 FROM sqlite_master").fetchone() is not None


@contextlib.contextmanager
def _held(path: Path) -> Iterator[None]:
    """Hold the lock beside the file, or say who does."""
    lock_path = path.resolve().with_name(path.resolve().name + ".lock")
    descriptor = platform.open_private(lock_path)
    try:
        if not platform.try_lock(descriptor):
            holder = os.read(descriptor, 200).decode(errors="replace").strip()
            raise StoreError(
                f"{path} is in use by another task server ({holder}); "
                "stop that one, or give this one another file"
            )
        os.ftruncate(descriptor, 0)
        since = datetime.now().astimezone().isoformat(" ", "seconds")
        os.write(descriptor, f"pid {os.getpid()}, since {since}\n".encode())
        yield
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def _said_plainly(path: Path) -> Iterator[None]:
    """Turn what SQLite and the system say into a `StoreError` that names the file."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        if "not a database" in str(error):
            raise StoreError(f"{path}: expected a task database, found another file") from None
        raise StoreError(f"{path}: the task database cannot be used: {error}") from error
    except OSError as error:
        raise StoreError(f"{path}: the task database cannot be opened: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise StoreError(f"{path}: the task database holds a damaged task: {error}") from error
