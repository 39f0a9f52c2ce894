"""Ready-made stores for exactly-once services: in memory, and in an SQLite file."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from taskrpc.errors import StoreError
from taskrpc.storage.completions import (
    CompletionBatch,
    has_tables,
    make_tables,
    read_completions,
    read_store_id,
)
from taskrpc.storage.database import Database
from taskrpc.storage.memory import KeptCompletions
from taskrpc.storage.writer import Writer
from taskrpc.wire.once import Client, Completion, Remembered

Statement: TypeAlias = tuple[str, Sequence[Any] | Mapping[str, Any]]
"""One SQL statement and its parameters, as `sqlite3.Connection.execute` takes them."""

_ENDS_TRANSACTIONS = re.compile(
    r"\s*(BEGIN|COMMIT|END|ROLLBACK|SAVEPOINT|RELEASE|ATTACH|DETACH|PRAGMA|VACUUM)\b", re.IGNORECASE
)


class MemoryCompletions:
    """Keeps what an exactly-once service has done for as long as the object itself lasts.

    An effect is a function without arguments, called once.
    """

    def __init__(self) -> None:
        self._store_id = os.urandom(16)
        self._kept = KeptCompletions()

    async def recall(self) -> Remembered:
        """Return what is remembered."""
        return Remembered(self._store_id, self._kept.all())

    def complete(
        self,
        completion: Completion | None,
        effect: Callable[[], object] | None = None,
        forgotten: Sequence[Client] = (),
    ) -> None:
        """Call the effect, remember its completion and forget clients.

        Raises:
            StoreError: the effect raised; nothing is remembered or forgotten.
        """
        try:
            if effect is not None:
                effect()
        except Exception as error:
            raise StoreError(f"the effect failed: {error}") from error
        self._kept.keep(completion, forgotten)


class SqliteCompletions:
    """Keeps what an exactly-once service has done in an SQLite file, beside the service's tables.

    An effect is a sequence of `(sql, parameters)`, done in the transaction that remembers the
    request. The file is the store's for writing, from the first use until `close`; to look
    something up, a service reads it through a connection of its own.

    Args:
        path: the database file; made if it is not there. A file `<path>.lock` beside it says
            which process uses it.
        schema: statements that make the service's own tables where they lack, such as
            `CREATE TABLE IF NOT EXISTS …`; done whenever the file is opened.
    """

    def __init__(self, path: str | os.PathLike[str], schema: Sequence[str] = ()) -> None:
        self._path = Path(path).absolute()
        self._schema = tuple(schema)
        self._writer: Writer[_Done] = Writer(self._open_file, _write)

    async def recall(self) -> Remembered:
        """Return what is remembered; a file that broke is opened anew.

        Raises:
            StoreError: it cannot be read, or another process uses it.
        """
        await self._writer.mend()
        return await self._writer.read(_read)

    async def complete(
        self,
        completion: Completion | None,
        effect: Sequence[Statement] | None = None,
        forgotten: Sequence[Client] = (),
    ) -> None:
        """Do an effect, remember its completion and forget clients, on disk when it returns.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: nobody knows whether it was, before `recall`.
        """
        statements = tuple(effect or ())
        for sql, _ in statements:
            if _ENDS_TRANSACTIONS.match(sql):
                raise StoreError(f"an effect is part of a transaction: it cannot do {sql!r}")
        await self._writer.change(_Done(completion, statements, forgotten))

    @property
    def transactions(self) -> Mapping[int, int]:
        """How many transactions there were, by how many calls shared one."""
        return self._writer.transactions

    async def close(self) -> None:
        """Write everything into the one file and let others use it."""
        await self._writer.close()

    def _open_file(self) -> Database:
        return Database(self._path, self._prepare, lambda _: None, holder="program")

    def _prepare(self, connection: sqlite3.Connection) -> None:
        if not has_tables(connection):
            make_tables(connection)
        for statement in self._schema:
            connection.execute(statement)


class _Done:
    """One request's effect and what is remembered of it."""

    __slots__ = ("completion", "effect", "forgotten")

    def __init__(
        self,
        completion: Completion | None,
        effect: Sequence[Statement],
        forgotten: Sequence[Client],
    ) -> None:
        self.completion, self.effect, self.forgotten = completion, effect, forgotten


def _read(connection: sqlite3.Connection) -> Remembered:
    return Remembered(read_store_id(connection), read_completions(connection))


def _write(database: Database, changes: Sequence[_Done]) -> None:
    def work(connection: sqlite3.Connection) -> None:
        batch = CompletionBatch()
        for change in changes:
            for sql, parameters in change.effect:
                connection.execute(sql, parameters)
            batch.add(change.completion, change.forgotten)
        batch.write(connection)

    database.change(work)
