"""Ready-made stores for exactly-once services: in memory, and in an SQLite file."""

from __future__ import annotations

import contextlib
import os
import re
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from taskrpc.errors import StoreError
from taskrpc.exactly_once.completions import (
    CompletionBatch,
    CompletionIndex,
    create_completion_table,
    read_completions,
)
from taskrpc.request_ids.ids import ClientKey, Completion, StoredCompletions
from taskrpc.storage.database import (
    Database,
    MemoryDatabase,
    create_store,
    has_store,
    read_store_id,
)
from taskrpc.storage.error_texts import is_about_the_file
from taskrpc.storage.writer import NOTHING_STORED, Writer

Parameters: TypeAlias = Sequence[Any] | Mapping[str, Any]

Statement: TypeAlias = tuple[str, Parameters]
"""One SQL statement and its parameters, as `sqlite3.Connection.execute` takes them."""

_ENDS_TRANSACTIONS = re.compile(
    r"\s*(BEGIN|COMMIT|END|ROLLBACK|SAVEPOINT|RELEASE|ATTACH|DETACH|PRAGMA|VACUUM)\b", re.IGNORECASE
)


class MemoryCompletions:
    """Keeps what an exactly-once service has done for as long as the object itself lasts.

    It takes the effects of `SqliteCompletions`, for tables in memory, so that a test can replace
    one by the other. An effect may also be a function without arguments, which is called once.

    Args:
        schema: statements that make the service's own tables, as for `SqliteCompletions`.
    """

    def __init__(self, schema: Sequence[str] = ()) -> None:
        self._store_id = os.urandom(16)
        self._index = CompletionIndex()
        self._schema = tuple(schema)
        self._guard = _Guard()
        self._tables: MemoryDatabase | None = None

    async def recall(self) -> StoredCompletions:
        """Return what is remembered."""
        return StoredCompletions(self._store_id, self._index.all())

    def complete(
        self,
        completion: Completion | None,
        effect: Callable[[], object] | Sequence[Statement] | None = None,
        forgotten: Sequence[ClientKey] = (),
    ) -> None:
        """Apply the effect, remember its completion and forget clients.

        Raises:
            StoreError: the effect failed; nothing is remembered, forgotten or changed in the
                tables.
        """
        if effect is not None:
            self._apply(effect)
        self._index.add(completion, forgotten)

    async def query(self, sql: str, parameters: Parameters = ()) -> list[tuple[Any, ...]]:
        """Return the rows that a SELECT finds in the service's tables. Raises StoreError."""
        return self._opened().read(lambda found: self._guard.look_up(found, sql, parameters))

    async def close(self) -> None:
        """Do nothing: this store has nothing to close, but `SqliteCompletions` has."""

    def _apply(self, effect: Callable[[], object] | Sequence[Statement]) -> None:
        try:
            if callable(effect):
                effect()
            else:
                statements = _statements(effect)
                self._opened().change(lambda tables: self._guard.carry_out(tables, statements))
        except StoreError:
            raise
        except Exception as error:
            raise _refused(f"the effect failed: {error}") from error

    def _opened(self) -> MemoryDatabase:
        if self._tables is None:
            self._tables = MemoryDatabase(self._prepare, self._guard.watch)
        return self._tables

    def _prepare(self, connection: sqlite3.Connection) -> None:
        _make_own_tables(connection, self._schema)


class SqliteCompletions:
    """Keeps what an exactly-once service has done in an SQLite file, beside the service's tables.

    An effect is a sequence of `(sql, parameters)`, done in the transaction that remembers the
    request. The file is the store's for writing, from the first use until `close`; to look
    something up, a service uses `query`, or reads the file through a connection of its own.

    Args:
        path: the database file; made if it is not there. A file `<path>.lock` beside it says
            which process uses it. `:memory:` makes no file; all is forgotten at `close`.
        schema: statements that make the service's own tables where they lack, such as
            `CREATE TABLE IF NOT EXISTS …`; done whenever the file is opened.
    """

    def __init__(self, path: str | os.PathLike[str], schema: Sequence[str] = ()) -> None:
        self._path = None if str(path) == ":memory:" else Path(path).absolute()
        self._schema = tuple(schema)
        self._guard = _Guard()
        self._writer: Writer[_Done] = Writer(self._open_file, self._write)

    async def recall(self) -> StoredCompletions:
        """Return what is remembered; a file that broke is opened anew.

        Raises:
            StoreError: it cannot be read, or another process uses it.
        """
        await self._writer.reopen()
        return await self._writer.read(_read)

    async def complete(
        self,
        completion: Completion | None,
        effect: Sequence[Statement] | None = None,
        forgotten: Sequence[ClientKey] = (),
    ) -> None:
        """Do an effect, remember its completion and forget clients, on disk when it returns.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: nobody knows whether it was, before `recall`.
        """
        await self._writer.change(_Done(completion, _statements(effect), forgotten))

    async def query(self, sql: str, parameters: Parameters = ()) -> list[tuple[Any, ...]]:
        """Return the rows that a SELECT finds in the database. Raises StoreError."""
        return await self._writer.read(lambda found: self._guard.look_up(found, sql, parameters))

    @property
    def transactions(self) -> Mapping[int, int]:
        """How many transactions there were, by how many calls shared one."""
        return self._writer.transactions

    async def close(self) -> None:
        """Write everything into the one file and let others use it."""
        await self._writer.close()

    def _open_file(self) -> Database | MemoryDatabase:
        if self._path is None:
            return MemoryDatabase(self._prepare, self._guard.watch)
        return Database(self._path, self._prepare, self._guard.watch, holder="program")

    def _write(self, database: Database | MemoryDatabase, changes: Sequence[_Done]) -> None:
        def work(connection: sqlite3.Connection) -> None:
            batch = CompletionBatch()
            for change in changes:
                self._guard.carry_out(connection, change.effect)
                batch.add(change.completion, change.forgotten)
            batch.write(connection)

        database.change(work)

    def _prepare(self, connection: sqlite3.Connection) -> None:
        if not has_store(connection):
            create_store(connection)
            create_completion_table(connection)
        _make_own_tables(connection, self._schema)


class _Done:
    """One request's effect and what is remembered of it."""

    __slots__ = ("completion", "effect", "forgotten")

    def __init__(
        self,
        completion: Completion | None,
        effect: Sequence[Statement],
        forgotten: Sequence[ClientKey],
    ) -> None:
        self.completion, self.effect, self.forgotten = completion, effect, forgotten


class _Guard:
    """Runs a service's statements, and refuses every statement that would end the transaction.

    One that ended it would leave behind the effects of others without their completions.
    """

    _FORBIDDEN = frozenset(
        {
            sqlite3.SQLITE_TRANSACTION,
            sqlite3.SQLITE_SAVEPOINT,
            sqlite3.SQLITE_ATTACH,
            sqlite3.SQLITE_DETACH,
            sqlite3.SQLITE_PRAGMA,
        }
    )

    def __init__(self) -> None:
        self._is_on = False

    def watch(self, connection: sqlite3.Connection) -> None:
        """Be asked about each statement that the connection compiles."""
        connection.set_authorizer(self._may)

    def carry_out(self, connection: sqlite3.Connection, effect: Sequence[Statement]) -> None:
        """Run an effect's statements. Raises ValueError for one that ends the transaction."""
        self._is_on = True
        try:
            for sql, parameters in effect:
                _do(connection, sql, parameters)
        finally:
            self._is_on = False

    def look_up(
        self, connection: sqlite3.Connection, sql: str, parameters: Parameters
    ) -> list[tuple[Any, ...]]:
        """Return the rows of a statement that cannot change anything."""
        connection.execute("PRAGMA query_only = ON")
        connection.text_factory, before = str, connection.text_factory
        self._is_on = True
        try:
            with _about_statements("the query failed"):
                return connection.execute(sql, parameters).fetchall()
        finally:
            self._is_on = False
            connection.text_factory = before
            connection.execute("PRAGMA query_only = OFF")

    def _may(self, action: int, *_: str | None) -> int:
        denied = self._is_on and action in self._FORBIDDEN
        return sqlite3.SQLITE_DENY if denied else sqlite3.SQLITE_OK


def _statements(effect: Any) -> list[Statement]:
    try:
        statements = list(effect or ())
        is_right = all(isinstance(sql, str) for sql, _ in statements)
    except (TypeError, ValueError):
        is_right = False
    if not is_right:
        raise _refused(f"expected an effect of pairs [(sql, parameters), …], got {effect!r:.200}")
    for sql, _ in statements:
        if _ENDS_TRANSACTIONS.match(sql):
            raise _refused(_not_part(sql))
    return statements


def _make_own_tables(connection: sqlite3.Connection, schema: Sequence[str]) -> None:
    with _about_statements("the service's own tables cannot be made"):
        for statement in schema:
            connection.execute(statement)


@contextlib.contextmanager
def _about_statements(problem: str) -> Iterator[None]:
    """Raise StoreError for what is wrong with a service's statements; the file is not to blame."""
    try:
        yield
    except sqlite3.Error as error:
        if is_about_the_file(error):
            raise
        raise _refused(f"{problem}: {error}") from error


def _refused(problem: str) -> StoreError:
    """An error whose text is only for the server's log, since it may contain SQL."""
    error = StoreError(problem)
    error.for_callers = NOTHING_STORED
    return error


def _do(connection: sqlite3.Connection, sql: str, parameters: Any) -> None:
    try:
        connection.execute(sql, parameters)
    except sqlite3.DatabaseError as error:
        if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_AUTH:
            raise ValueError(_not_part(sql)) from error
        raise


def _not_part(sql: str) -> str:
    return f"an effect is part of a transaction: it cannot do {sql!r}"


def _read(connection: sqlite3.Connection) -> StoredCompletions:
    return StoredCompletions(read_store_id(connection), read_completions(connection))
