"""The ended tasks of a fleet, read from PostgreSQL while its servers run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from taskrpc.errors import StoreError
from taskrpc.robot.fleet.postgres.connection import (
    FAILURES,
    Connection,
    DatabaseUrl,
    answered,
    close,
)
from taskrpc.robot.fleet.postgres.schema import TABLE_EXISTS, VERSION, check_version
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.records.archive import PAGE, End

_VERSION = "SELECT version FROM taskrpc_fleet"
_RECENT = "SELECT record FROM taskrpc_task WHERE state = ANY(%s)"
_ARCHIVED = """
    SELECT record FROM taskrpc_history WHERE (ended_at, task_id) > (%s::float8, %s::bigint)
    ORDER BY ended_at, task_id LIMIT %s
"""
_ENDED = [state.value for state in TaskState if state.is_ended]

_decoder = msgspec.json.Decoder(Task)


class PostgresEndedTasks:
    """The ended tasks of a fleet; it neither waits for the fleet's lock nor takes it.

    Args:
        url: see `PostgresStore`.

    Raises:
        TaskRpcError: the URL is not valid.
    """

    def __init__(self, url: str) -> None:
        self._url = DatabaseUrl(url)
        self._connection: Connection | None = None

    async def recent(self) -> list[Task]:
        """Return the ended tasks that servers have in memory. Raises StoreError."""
        return await self._tasks(_RECENT, (_ENDED,))

    async def archived(self, after: End) -> list[Task]:
        """Return the next `PAGE` archived tasks in the order of their ends. Raises StoreError."""
        return await self._tasks(_ARCHIVED, (*after, PAGE))

    async def close(self) -> None:
        """Disconnect."""
        connection, self._connection = self._connection, None
        await close(connection)

    async def _tasks(self, query: str, values: Sequence[object]) -> list[Task]:
        try:
            connection = await self._connected()
            records = await answered(connection, _values(connection, query, values))
        except FAILURES as error:
            raise self._url.error("cannot be read", error) from error
        try:
            return [_decoder.decode(record) for record in records]
        except msgspec.DecodeError as error:
            problem = f"a record of an ended task cannot be read: {error}"
            raise StoreError(f"{self._url} {problem}; restore a backup") from None

    async def _connected(self) -> Connection:
        if self._connection is None:
            self._connection = await self._url.connect("taskrpc export")
            await self._check_version(self._connection)
        return self._connection

    async def _check_version(self, connection: Connection) -> None:
        exists = await answered(connection, _values(connection, TABLE_EXISTS))
        versions = await answered(connection, _values(connection, _VERSION)) if exists[0] else []
        version = versions[0] if versions else 0
        check_version(version)
        if version < VERSION:
            raise StoreError(
                f"{self._url} expected the tables of a fleet of version {VERSION}, found version"
                f" {version}: start a taskrpc-server of this version once, which makes them"
            )


async def _values(connection: Connection, query: str, values: Sequence[object] = ()) -> list[Any]:
    """Return the only column of the rows of a statement."""
    cursor = await connection.execute(query.encode(), values)
    return [value for (value,) in await cursor.fetchall()]
