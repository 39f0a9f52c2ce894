"""All ended tasks of a database, in pages: a reader needs little memory and holds no server."""

from __future__ import annotations

import sqlite3
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Protocol, TypeAlias, TypeVar

from taskrpc.errors import StoreError
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records import task_tables
from taskrpc.spi import Damaged

PAGE = 1000
"""The most archived tasks in a page."""

End: TypeAlias = tuple[float, int]
"""The order of ended tasks: when a task ended, and its id."""

_Result = TypeVar("_Result")


class EndedTasks(Protocol):
    """The ended tasks of a database. Each method reads for a short time and locks nothing."""

    async def recent(self) -> list[Task]:
        """Return the ended tasks that servers have in memory. Raises StoreError."""

    async def archived(self, after: End) -> list[Task]:
        """Return the next `PAGE` archived tasks in the order of their ends. Raises StoreError."""

    async def close(self) -> None:
        """Release the database."""


def end_of(task: Task) -> End:
    """Return the place of an ended task in the order of ends."""
    return task.ended_at or 0.0, task.task_id


async def pages_of(source: EndedTasks, since: float) -> AsyncIterator[list[Task]]:
    """Iterate over the tasks that ended at an instant or later, the oldest end first.

    Tasks that end meanwhile may be missing. A task is never there twice, even if it is archived
    meanwhile. Raises StoreError.
    """
    found = (task for task in await source.recent() if (task.ended_at or 0.0) >= since)
    recent = sorted(found, key=end_of)
    known = {task.task_id for task in recent}
    after = (since, -1)
    while archived := await source.archived(after):
        after = end_of(archived[-1])
        older = [task for task in recent if end_of(task) <= after]
        recent = recent[len(older) :]
        older += (task for task in archived if task.task_id not in known)
        yield sorted(older, key=end_of)
    if recent:
        yield recent


class SqliteEndedTasks:
    """The ended tasks in the file of a task server, which may run meanwhile.

    Args:
        path: the file; it is only read.

    Raises:
        StoreError: there is no such file, or it is not a task database of this format.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        if not path.is_file():
            raise StoreError(
                f"{path}: expected the database of a task server, found no such file;"
                " start taskrpc-server, or name its database with --db"
            )
        uri = f"{path.absolute().as_uri()}?mode=ro"
        try:
            self._connection = sqlite3.connect(uri, uri=True, isolation_level=None)
        except sqlite3.Error as error:
            raise StoreError(f"{path}: {error}") from None
        self._connection.text_factory = bytes  # text in a damaged file may not be valid UTF-8
        try:
            self._read(task_tables.check_format)
        except StoreError:
            self._connection.close()
            raise

    async def recent(self) -> list[Task]:
        """Return the ended tasks that the server has in memory. Raises StoreError."""
        return self._read(task_tables.ended)

    async def archived(self, after: End) -> list[Task]:
        """Return the next `PAGE` archived tasks in the order of their ends. Raises StoreError."""
        return self._read(lambda connection: task_tables.archived(connection, after, PAGE))

    async def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def _read(self, read: Callable[[sqlite3.Connection], _Result]) -> _Result:
        try:
            return read(self._connection)
        except Damaged as damaged:
            where = f", row {damaged.where}" if damaged.where else ""
            raise StoreError(f"{self._path}: {damaged}{where}; restore a copy") from None
        except (sqlite3.Error, StoreError) as error:
            raise StoreError(f"{self._path}: {error}") from None
