"""Tasks in an SQLite file: a change is on the disk before its call returns."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records import task_tables
from taskrpc.robot.tasks.records.history import DEFAULT, History, newest_end
from taskrpc.robot.tasks.records.store import Stored
from taskrpc.robot.tasks.records.task_tables import Change
from taskrpc.spi import ClientKey, Completion, Database, FileInUse, Writer


class SqliteStore:
    """A `TaskStore` in one file, which it locks from its first use until `close`.

    A thread of its own makes all changes, in the order of the calls. Calls that wait at the same
    time share one transaction.

    Args:
        path: the database file; it is made if it does not exist. The file `<path>.lock` beside it
            says which server uses the database.
        history: which ended tasks are kept.
    """

    def __init__(self, path: str | os.PathLike[str], *, history: History = DEFAULT) -> None:
        self.history = history
        """Which ended tasks are kept."""
        self._path = Path(path).absolute()
        write = partial(task_tables.write, history=history)
        self._writer: Writer[Change] = Writer(self._open_file, write)
        self._clearing = False
        """Whether to accept a missing or incomplete file, because `clear` is running."""

    async def claim(self, waiting: Callable[[FileInUse], object] | None = None) -> None:
        """Wait until no other process uses the file, then lock it.

        `waiting` is called once if the file is in use, with the error that names the other process.

        Raises:
            StoreError: the file cannot be locked.
        """
        await self._writer.claim(waiting or (lambda error: None))

    def open_now(self) -> bool:
        """Open and lock the file, unless it is open; return whether this opened it.

        Raises:
            FileInUse: another process uses it.
            StoreError: it cannot be used.
        """
        return self._writer.open_now(lambda connection: None)

    async def load(self) -> Stored:
        """Return everything that the store remembers; see `TaskStore.load`."""
        return await self._writer.read(task_tables.load)

    def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
    ) -> asyncio.Future[None]:
        """Remember and forget in one transaction; the future resolves once that is on the disk."""
        rows = [task_tables.row_of(task) for task in saved]
        ended_at = newest_end(saved)
        return self._writer.change(Change(rows, forgotten, completion, clients, ended_at=ended_at))

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue is paused; it is on the disk when this returns."""
        await self._writer.change(Change(paused=paused))

    async def clear(self) -> None:
        """Forget everything and begin again with task 1, as another store."""
        self._clearing = True
        try:
            await self._writer.change_alone(task_tables.clear)
        finally:
            self._clearing = False

    @property
    def transactions(self) -> Mapping[int, int]:
        """The number of transactions for each number of calls that shared one."""
        return self._writer.transactions

    async def close(self) -> None:
        """Write everything into the one file and unlock it."""
        await self._writer.close()

    def _open_file(self) -> Database:
        prepare, equip = task_tables.prepare, task_tables.equip
        holder, clearing = "task server", self._clearing
        return Database(self._path, prepare, equip, holder=holder, clearing=clearing)
