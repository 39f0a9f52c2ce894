"""The tables of the task server's SQLite file: create, read and write them."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from typing import TypeAlias

import msgspec

from taskrpc.errors import StoreError
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records.history import AT_ONCE, History
from taskrpc.robot.tasks.records.store import Stored
from taskrpc.spi import (
    ClientKey,
    Completion,
    CompletionBatch,
    Damaged,
    Database,
    clear_completions,
    create_completion_tables,
    read_records,
    read_stored_completions,
    refuse_other_tables,
    with_checksum,
)

FORMAT = 3
"""The version of the file's layout, kept in `PRAGMA user_version`."""
_APPLICATION_ID = 0x54525043  # "TRPC"; marks our files among other SQLite databases

_HISTORY = (
    """
    CREATE TABLE history (
        number INTEGER PRIMARY KEY, task_id INTEGER NOT NULL, ended_at REAL NOT NULL,
        record TEXT NOT NULL, checksum INTEGER NOT NULL
    )
    """,
    "CREATE INDEX history_ended ON history (ended_at, task_id)",
)
"""The archived tasks. `number` counts them, so that removing the oldest takes no search."""
_TABLES = (
    """
    CREATE TABLE task (
        task_id INTEGER PRIMARY KEY, record TEXT NOT NULL, checksum INTEGER NOT NULL
    )
    """,
    "CREATE TABLE server (next_id INTEGER NOT NULL, paused INTEGER NOT NULL)",
    "INSERT INTO server VALUES (1, 0)",
    *_HISTORY,
    f"PRAGMA application_id = {_APPLICATION_ID}",
    f"PRAGMA user_version = {FORMAT}",
)
_ARCHIVE = """
    INSERT INTO history (task_id, ended_at, record, checksum)
    SELECT task_id, json_extract(record, '$.ended_at'), record, checksum FROM task
    WHERE NEW.archives AND task_id IN (SELECT value FROM json_each(NEW.gone))
    AND json_extract(record, '$.ended_at') IS NOT NULL ORDER BY 2, 1
"""
# A condition whose value is NULL removes nothing.
_PRUNE = f"""
    DELETE FROM history WHERE number IN (
        SELECT number FROM history
        WHERE number <= (SELECT max(number) FROM history) - NEW.archived
        ORDER BY number LIMIT {AT_ONCE}
    );
    DELETE FROM history WHERE number IN (
        SELECT number FROM history WHERE ended_at < NEW.kept_since
        ORDER BY ended_at, task_id LIMIT {AT_ONCE}
    )
"""
_SAVE = """
    INSERT OR REPLACE INTO task (task_id, checksum, record)
    SELECT json_extract(value, '$[0]'), json_extract(value, '$[1]'), json_extract(value, '$[2]')
    FROM json_each(NEW.saved)
"""
# One statement for the whole batch: each step of a statement takes the interpreter's lock away from
# the event loop.
_EQUIPMENT = (
    """
    CREATE TEMP VIEW IF NOT EXISTS batch AS
    SELECT '' AS saved, '' AS gone, 0 AS next_id, 0 AS paused,
           0 AS archives, 0 AS archived, 0 AS kept_since,
           '' AS lapsed, '' AS completed, '' AS settled, 0 AS commits
    """,
    f"""
    CREATE TEMP TRIGGER IF NOT EXISTS write_batch INSTEAD OF INSERT ON batch BEGIN
        {_SAVE};
        UPDATE server SET next_id = NEW.next_id WHERE next_id < NEW.next_id;
        UPDATE server SET paused = NEW.paused WHERE NEW.paused IS NOT NULL;
        {_ARCHIVE};
        DELETE FROM task WHERE task_id IN (SELECT value FROM json_each(NEW.gone));
        {_PRUNE};
        {CompletionBatch.sql("NEW.lapsed", "NEW.completed", "NEW.settled")};
        UPDATE taskrpc_store SET commits = NEW.commits;
    END
    """,
)
_WRITE = "INSERT INTO batch VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"

_ARCHIVED = """
    SELECT task_id, record, checksum FROM history WHERE (ended_at, task_id) > (?, ?)
    ORDER BY ended_at, task_id LIMIT ?
"""

Row: TypeAlias = tuple[int, int, str]
"""A row of the task table: task id, checksum, record."""


def prepare(connection: sqlite3.Connection) -> None:
    """Create the tables of a new file, or upgrade format 2; refuse any other file.

    Raises:
        StoreError: it is another program's database, or another version of taskrpc wrote it.
    """
    is_new = connection.execute("SELECT 1 FROM sqlite_master").fetchone() is None
    if is_new and _pragma(connection, "application_id") == 0:
        _create(connection)
    version = _version(connection)
    if version == FORMAT - 1:
        for statement in (*_HISTORY, f"PRAGMA user_version = {FORMAT}"):
            connection.execute(statement)
    elif version != FORMAT:
        raise StoreError(
            f"expected a task database of format {FORMAT}, found format {version}; "
            "use the taskrpc that wrote it, or another file"
        )
    refuse_other_tables(connection, _create)


def _create(connection: sqlite3.Connection) -> None:
    create_completion_tables(connection)
    for statement in _TABLES:
        connection.execute(statement)


def equip(connection: sqlite3.Connection) -> None:
    """Create the temporary view and trigger that `write` needs."""
    for statement in _EQUIPMENT:
        connection.execute(statement)


def load(connection: sqlite3.Connection) -> Stored:
    """Read everything; raises Damaged if a row or a table is damaged."""
    # A damaged tree may lose whole rows silently. Checksums only protect the rows that are found.
    found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != b"ok":
        raise Damaged("task", " ".join(found.decode(errors="replace").split()))
    rows = connection.execute("SELECT task_id, record, checksum FROM task ORDER BY task_id")
    tasks = tuple(read_records(rows.fetchall(), Task, "task", "task_id"))
    server = connection.execute("SELECT next_id, paused FROM server").fetchone()
    if server is None or not all(isinstance(each, int) for each in server):
        raise Damaged("server", "expected one row with the next number and whether it is paused")
    next_id = max([server[0], *(task.task_id + 1 for task in tasks[-1:])])
    stored = read_stored_completions(connection)
    return Stored(tasks, next_id, stored.store_id, bool(server[1]), stored.completions)


def check_format(connection: sqlite3.Connection) -> None:
    """Refuse a file that is not of this format. Raises StoreError."""
    if (version := _version(connection)) != FORMAT:
        raise StoreError(
            f"expected a task database of format {FORMAT}, found format {version};"
            " start the taskrpc-server of this version with it, which upgrades older files"
        )


def ended(connection: sqlite3.Connection) -> list[Task]:
    """Return the ended tasks that are not archived. Raises Damaged."""
    rows = connection.execute("SELECT task_id, record, checksum FROM task")
    tasks = read_records(rows.fetchall(), Task, "task", "task_id")
    return [task for task in tasks if task.state.is_ended]


def archived(connection: sqlite3.Connection, after: tuple[float, int], most: int) -> list[Task]:
    """Return archived tasks behind one of them, in the order of their ends. Raises Damaged."""
    rows = connection.execute(_ARCHIVED, (*after, most))
    return read_records(rows.fetchall(), Task, "history", "task_id")


def row_of(task: Task) -> Row:
    """Return the row of a task."""
    return task.task_id, *with_checksum(msgspec.json.encode(task), task.task_id)


class Change(msgspec.Struct):
    """The changes of one call; the caller's thread encodes the rows, not the writer's."""

    saved: Sequence[Row] = ()
    forgotten: Sequence[int] = ()
    """Task ids."""
    completion: Completion | None = None
    clients: Sequence[ClientKey] = ()
    paused: bool | None = None
    """Whether the queue is paused; None: no change."""
    ended_at: float | None = None
    """When the last of the saved tasks ended; None if none has ended."""


def write(database: Database, changes: Sequence[Change], *, history: History) -> None:
    """Write changes, in order, in one transaction."""
    saved: dict[int, Row] = {}
    gone: dict[int, None] = {}
    completions = CompletionBatch()
    paused = ended_at = None
    for change in changes:
        for row in change.saved:
            saved[row[0]] = row
            gone.pop(row[0], None)
        gone.update(dict.fromkeys(change.forgotten))  # saved first, so that it can be archived
        completions.add(change.completion, change.clients)
        paused = paused if change.paused is None else change.paused
        ended_at = ended_at if change.ended_at is None else change.ended_at
    next_id = 1 + max(saved, default=0)
    values = _as_json(list(saved.values())), _as_json(list(gone)), next_id, paused
    limits = _limits(history, ended_at)
    database.change_at_once(_WRITE, (*values, *limits, *completions.rows()))


def _limits(history: History, ended_at: float | None) -> tuple[bool, int | None, float | None]:
    """Return whether forgotten tasks are archived, and what is removed after a task's end."""
    archives = history.archived != 0
    if ended_at is None:
        return archives, None, None
    return archives, history.archived, history.kept_since(ended_at)


def clear(connection: sqlite3.Connection) -> None:
    """Forget everything, in the open transaction."""
    connection.execute("DELETE FROM task")
    connection.execute("DELETE FROM history")
    connection.execute("DELETE FROM server")
    connection.execute("INSERT INTO server VALUES (1, 0)")
    clear_completions(connection)


def _as_json(rows: Sequence[object]) -> str:
    return msgspec.json.encode(rows).decode()


def _version(connection: sqlite3.Connection) -> int:
    """Return the format of a task database. Raises StoreError for another program's file."""
    if _pragma(connection, "application_id") != _APPLICATION_ID:
        raise StoreError("expected a task database, found another program's database")
    return _pragma(connection, "user_version")


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    """Return a number that SQLite keeps in the file's header."""
    value: int = connection.execute(f"PRAGMA {name}").fetchone()[0]
    return value
