"""Two stores for exactly-once services: in memory, and in an SQLite file."""

from __future__ import annotations

import contextlib
import os
import re
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from taskrpc.core.exactly_once.completions import (
    CompletionBatch,
    CompletionIndex,
    create_completion_table,
    delete_completions,
    read_completions,
)
from taskrpc.core.request_ids.ids import ClientKey, Completion, StoredCompletions
from taskrpc.core.storage.database import (
    Database,
    MemoryDatabase,
    create_store,
    has_store,
    read_store_id,
    replace_store_id,
)
from taskrpc.core.storage.error_texts import is_about_the_file
from taskrpc.core.storage.table_checks import refuse_other_tables
from taskrpc.core.storage.writer import NOTHING_STORED, Writer
from taskrpc.core.transport.chance import present_chance
from taskrpc.errors import StoreError

Parameters: TypeAlias = Sequence[Any] | Mapping[str, Any]

Statement: TypeAlias = tuple[str, Parameters]
"""One SQL statement and its parameters, as `sqlite3.Connection.execute` takes them."""

_ENDS_TRANSACTIONS = re.compile(
    r"\s*(BEGIN|COMMIT|END|ROLLBACK|SAVEPOINT|RELEASE|ATTACH|DETACH|PRAGMA|VACUUM)\b", re.IGNORECASE
)


class MemoryCompletions:
    """Keeps completions and effects in memory, as long as the object itself lasts.

    It accepts the effects of `SqliteCompletions` and applies them to tables in memory, so that a
    test can replace one store by the other. An effect may also be a function without arguments,
    which is called once.

    Args:
        schema: statements that create the service's own tables, as for `SqliteCompletions`.
    """

    completes_at_once = True
    """`complete` returns when everything is done, and cannot fail without an effect."""

    def __init__(self, schema: Sequence[str] = ()) -> None:
        self._store_id = present_chance().randbytes(16)
        self._index = CompletionIndex()
        self._schema = tuple(schema)
        self._guard = _Guard()
        self._tables: MemoryDatabase | None = None

    async def recall(self) -> StoredCompletions:
        """Return the store's id and its completions."""
        return StoredCompletions(self._store_id, self._index.all())

    def complete(
        self,
        completion: Completion | None,
        effect: Callable[[], object] | Sequence[Statement] | None = None,
        forgotten: Sequence[ClientKey] = (),
    ) -> None:
        """Apply an effect, store its completion and forget clients.

        Raises:
            StoreError: the effect failed; nothing was changed.
        """
        if effect is not None:
            self._apply(effect)
        self._index.add(completion, forgotten)

    async def query(self, sql: str, parameters: Parameters = ()) -> list[tuple[Any, ...]]:
        """Return the rows that a SELECT finds in the service's tables. Raises StoreError."""
        return self._opened().read(lambda found: self._guard.look_up(found, sql, parameters))

    async def close(self) -> None:
        """Do nothing; for compatibility with `SqliteCompletions`."""

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
    """Keeps completions in an SQLite file, together with the service's own tables.

    An effect is a sequence of `(sql, parameters)`. The store runs it in the transaction that stores
    the completion. Only the store may write to the file, from its first use until `close`. To read,
    a service uses `query`, or its own connection to the file.

    Args:
        path: the database file; created if it does not exist. A file `<path>.lock` beside it says
            which process uses it. `:memory:` creates no file, and `close` deletes everything.
        schema: statements that create the service's own tables, such as
            `CREATE TABLE IF NOT EXISTS …`; they run each time the file is opened.
    """

    def __init__(self, path: str | os.PathLike[str], schema: Sequence[str] = ()) -> None:
        self._path = None if str(path) == ":memory:" else Path(path).absolute()
        self._schema = tuple(schema)
        self._guard = _Guard()
        self._writer: Writer[_Done] = Writer(self._open_file, self._write)

    def open_now(self) -> None:
        """Open the file, so that a service with a file that it cannot use is never offered.

        Raises:
            StoreError: the file cannot be used, or another process uses it.
        """
        self._writer.open_now(read_stored_completions)

    async def recall(self) -> StoredCompletions:
        """Return the store's id and its completions; a broken file is opened again.

        Raises:
            StoreError: the file cannot be read, or another process uses it.
        """
        await self._writer.reopen()
        return await self._writer.read(read_stored_completions)

    async def complete(
        self,
        completion: Completion | None,
        effect: Sequence[Statement] | None = None,
        forgotten: Sequence[ClientKey] = (),
    ) -> None:
        """Apply an effect, store its completion and forget clients; on the disk when it returns.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: the change may have been made; `recall` shows whether it was.
        """
        await self._writer.change(_Done(completion, _statements(effect), forgotten))

    async def query(self, sql: str, parameters: Parameters = ()) -> list[tuple[Any, ...]]:
        """Return the rows that a SELECT finds in the database. Raises StoreError."""
        return await self._writer.read(lambda found: self._guard.look_up(found, sql, parameters))

    @property
    def transactions(self) -> Mapping[int, int]:
        """The number of transactions for each number of calls that shared one."""
        return self._writer.transactions

    async def close(self) -> None:
        """Write everything into the one file and release its lock."""
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
            create_completion_tables(connection)
        refuse_other_tables(connection, create_completion_tables)
        _make_own_tables(connection, self._schema)


class _Done:
    """One request's effect, its completion, and the clients to forget."""

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

    If a statement ended it, the effects of other requests would be stored without completions.
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
        """Check each statement that the connection compiles."""
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
            with _statement_errors("the query failed"):
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


def create_completion_tables(connection: sqlite3.Connection) -> None:
    """Create the tables of a new store for completions, in the open transaction."""
    create_store(connection)
    create_completion_table(connection)


def read_stored_completions(connection: sqlite3.Connection) -> StoredCompletions:
    """Return the id and all completions of a store. Raises Damaged."""
    return StoredCompletions(read_store_id(connection), read_completions(connection))


def clear_completions(connection: sqlite3.Connection) -> None:
    """Delete all completions in the open transaction, and give the store a new id."""
    delete_completions(connection)
    replace_store_id(connection)


def _make_own_tables(connection: sqlite3.Connection, schema: Sequence[str]) -> None:
    with _statement_errors("the service's own tables cannot be created"):
        for statement in schema:
            connection.execute(statement)


@contextlib.contextmanager
def _statement_errors(problem: str) -> Iterator[None]:
    """Raise StoreError for errors of a service's own statements; errors of the file pass."""
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
