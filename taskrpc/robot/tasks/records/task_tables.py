"""The tables of the task server's SQLite file: create, read and write them."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import msgspec

from taskrpc.errors import StoreError
from taskrpc.robot.tasks.model import Task
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

FORMAT = 2
"""The version of the file's layout, kept in `PRAGMA user_version`."""
_APPLICATION_ID = 0x54525043  # "TRPC"; marks our files among other SQLite databases

_TABLES = (
    """
    CREATE TABLE task (
        task_id INTEGER PRIMARY KEY, record TEXT NOT NULL, checksum INTEGER NOT NULL
    )
    """,
    "CREATE TABLE server (next_id INTEGER NOT NULL, paused INTEGER NOT NULL)",
    "INSERT INTO server VALUES (1, 0)",
    f"PRAGMA application_id = {_APPLICATION_ID}",
    f"PRAGMA user_version = {FORMAT}",
)
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
           '' AS lapsed, '' AS completed, '' AS settled, 0 AS commits
    """,
    f"""
    CREATE TEMP TRIGGER IF NOT EXISTS write_batch INSTEAD OF INSERT ON batch BEGIN
        {_SAVE};
        UPDATE server SET next_id = NEW.next_id WHERE next_id < NEW.next_id;
        UPDATE server SET paused = NEW.paused WHERE NEW.paused IS NOT NULL;
        DELETE FROM task WHERE task_id IN (SELECT value FROM json_each(NEW.gone));
        {CompletionBatch.sql("NEW.lapsed", "NEW.completed", "NEW.settled")};
        UPDATE taskrpc_store SET commits = NEW.commits;
    END
    """,
)
_WRITE = "INSERT INTO batch VALUES (?, ?, ?, ?, ?, ?, ?, ?)"

Row: TypeAlias = tuple[int, int, str]
"""A row of the task table: task id, checksum, record."""


def prepare(connection: sqlite3.Connection) -> None:
    """Create the tables of a new file; refuse a file that is not of this format.

    Raises:
        StoreError: it is another program's database, or another version of taskrpc wrote it.
    """
    is_new = connection.execute("SELECT 1 FROM sqlite_master").fetchone() is None
    if is_new and _pragma(connection, "application_id") == 0:
        _create(connection)
    if _pragma(connection, "application_id") != _APPLICATION_ID:
        raise StoreError("expected a task database, found another program's database")
    version = _pragma(connection, "user_version")
    if version != FORMAT:
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


def write(database: Database, changes: Sequence[Change]) -> None:
    """Write changes, in order, in one transaction."""
    tasks: dict[int, Row | None] = {}
    completions = CompletionBatch()
    paused = None
    for change in changes:
        tasks.update({row[0]: row for row in change.saved})
        tasks.update(dict.fromkeys(change.forgotten))
        completions.add(change.completion, change.clients)
        paused = paused if change.paused is None else change.paused
    database.change_at_once(_WRITE, _values(tasks, completions, paused))


def _values(
    tasks: Mapping[int, Row | None], completions: CompletionBatch, paused: bool | None
) -> Sequence[object]:
    """Return the parameters of `_WRITE`; task ids without a row are forgotten."""
    saved = [row for row in tasks.values() if row is not None]
    gone = [number for number, row in tasks.items() if row is None]
    next_id = 1 + max((number for number, *_ in saved), default=0)
    return _as_json(saved), _as_json(gone), next_id, paused, *completions.rows()


def clear(connection: sqlite3.Connection) -> None:
    """Forget everything, in the open transaction."""
    connection.execute("DELETE FROM task")
    connection.execute("DELETE FROM server")
    connection.execute("INSERT INTO server VALUES (1, 0)")
    clear_completions(connection)


def _as_json(rows: Sequence[object]) -> str:
    return msgspec.json.encode(rows).decode()


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    """Return a number that SQLite keeps in the file's header."""
    value: int = connection.execute(f"PRAGMA {name}").fetchone()[0]
    return value
