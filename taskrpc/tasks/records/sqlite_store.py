"""Tasks in an SQLite file: what was acknowledged is on the disk."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from taskrpc.request_ids.ids import Client, Completion
from taskrpc.storage.database import Database
from taskrpc.storage.lock import FileInUse
from taskrpc.storage.writer import Writer
from taskrpc.tasks.model import Task
from taskrpc.tasks.records import task_tables
from taskrpc.tasks.records.store import Stored
from taskrpc.tasks.records.task_tables import Change


class SqliteStore:
    """A `TaskStore` in one file, which it keeps for itself from the first use until `close`.

    Everything happens in one thread of its own, in the order of the calls; calls of one moment
    share one transaction, and wait for the disk together.

    Args:
        path: the database file; made if it is not there. A file `<path>.lock` beside it says
            which server uses it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path).absolute()
        self._writer: Writer[Change] = Writer(self._open_file, task_tables.write)
        self._anew = False
        """Whether a missing or incomplete file is accepted, because it is being cleared."""

    async def claim(self, waiting: Callable[[FileInUse], object] | None = None) -> None:
        """Wait until no other process uses the file, and keep it from then on.

        `waiting` is called once, with the error that says by whom, where it is in use.

        Raises StoreError.
        """
        await self._writer.claim(waiting or (lambda error: None))

    async def load(self) -> Stored:
        """Return everything that is remembered; see `TaskStore.load`."""
        return await self._writer.read(task_tables.load)

    def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[Client] = (),
    ) -> asyncio.Future[None]:
        """Remember and forget in one transaction; what it returns is done once it is on disk."""
        rows = [task_tables.row_of(task) for task in saved]
        return self._writer.change(Change(rows, forgotten, completion, clients))

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue stands still, on disk when it returns."""
        await self._writer.change(Change(paused=paused))

    async def clear(self) -> None:
        """Forget everything and begin again with number 1, as another store."""
        self._anew = True
        try:
            await self._writer.change_alone(task_tables.clear)
        finally:
            self._anew = False

    @property
    def transactions(self) -> Mapping[int, int]:
        """How many transactions there were, by how many calls shared one."""
        return self._writer.transactions

    async def close(self) -> None:
        """Write everything into the one file and let others use it."""
        await self._writer.close()

    def _open_file(self) -> Database:
        prepare, equip = task_tables.prepare, task_tables.equip
        return Database(self._path, prepare, equip, holder="task server", anew=self._anew)
