"""Tasks in an SQLite file: what was acknowledged is on the disk."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from taskrpc.errors import StoreError
from taskrpc.storage.completions import CompletionBatch
from taskrpc.storage.database import Database
from taskrpc.storage.records import Damaged
from taskrpc.tasks import task_tables
from taskrpc.tasks.model import Task
from taskrpc.tasks.store import Stored
from taskrpc.wire.once import Client, Completion

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
        self._database: Database | None = None

    async def load(self) -> Stored:
        """Return everything that is remembered; see `TaskStore.load`."""
        return await self._do(task_tables.load)

    async def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[Client] = (),
    ) -> None:
        """Remember and forget in one transaction, on disk when it returns."""
        # Encoded here: the thread would only take turns with the loop for it.
        rows = [task_tables.row(task) for task in saved]

        def write(connection: sqlite3.Connection) -> None:
            task_tables.write_tasks(connection, rows, forgotten)
            batch = CompletionBatch()
            batch.add(completion, clients)
            batch.write(connection)

        await self._do(write)

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue stands still, on disk when it returns."""
        await self._do(lambda connection: task_tables.write_pause(connection, paused))

    async def clear(self) -> None:
        """Forget everything and begin again with number 1, as another store."""
        await self._do(task_tables.clear)

    async def close(self) -> None:
        """Write everything into the one file and let others use it."""
        thread, self._thread = self._thread, None
        if thread is not None:
            await asyncio.get_running_loop().run_in_executor(thread, self._close)
            thread.shutdown()

    async def _do(self, work: Callable[[sqlite3.Connection], _Result]) -> _Result:
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="taskrpc-store")
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, self._in_thread, work)

    def _in_thread(self, work: Callable[[sqlite3.Connection], _Result]) -> _Result:
        with _said_plainly(self._path):
            if self._database is None:
                self._database = Database(self._path, task_tables.prepare, holder="task server")
            with self._database.transaction() as connection:
                return work(connection)

    def _close(self) -> None:
        if self._database is not None:
            self._database.close()
            self._database = None


@contextlib.contextmanager
def _said_plainly(path: Path) -> Iterator[None]:
    """Turn what SQLite and the system say into a `StoreError` that names the file."""
    try:
        yield
    except StoreError as error:
        sentence = str(error)
        raise StoreError(sentence if str(path) in sentence else f"{path}: {sentence}") from None
    except Damaged as damage:
        advice = f'or give it up: sqlite3 {path} "DELETE FROM {damage.table} WHERE {damage.where}"'
        if not damage.where:
            advice = "or move it away to begin anew"
        row = f", row {damage.where}" if damage.where else ""
        raise StoreError(
            f"{path} is damaged (table {damage.table}{row}: {damage.problem}); "
            f"restore the file from a copy, {advice}"
        ) from None
    except sqlite3.DatabaseError as error:
        if "not a database" in str(error):
            raise StoreError(f"{path}: expected a task database, found another file") from None
        raise StoreError(f"{path}: the task database cannot be used: {error}") from error
    except OSError as error:
        raise StoreError(f"{path}: the task database cannot be opened: {error.strerror}") from error
