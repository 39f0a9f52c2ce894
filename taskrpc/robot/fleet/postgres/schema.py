"""The tables of a fleet in PostgreSQL: create and upgrade them."""

from __future__ import annotations

from collections.abc import Sequence

from taskrpc.errors import StoreError
from taskrpc.robot.fleet.postgres.connection import FAILURES, Connection

_MIGRATION_LOCK = 0x54525043  # the key of an advisory lock: "TRPC"

MIGRATIONS: tuple[tuple[str, ...], ...] = (
    (  # version 1
        """
        CREATE TABLE taskrpc_fleet (
            is_only boolean PRIMARY KEY DEFAULT true CHECK (is_only),
            version integer NOT NULL, store_id bytea NOT NULL, revision bigint NOT NULL,
            record text NOT NULL
        )
        """,
        """
        CREATE TABLE taskrpc_task (
            task_id bigint PRIMARY KEY, revision bigint NOT NULL, state text NOT NULL,
            robot text NOT NULL, record text NOT NULL
        )
        """,
        "CREATE INDEX taskrpc_task_revision ON taskrpc_task (revision)",
        """
        CREATE TABLE taskrpc_robot (
            name text PRIMARY KEY, revision bigint NOT NULL, lease_until timestamptz NOT NULL,
            record text NOT NULL
        )
        """,
        """
        CREATE TABLE taskrpc_completion (
            principal text NOT NULL, client text NOT NULL, sequence text NOT NULL,
            record text NOT NULL, checksum bigint NOT NULL,
            PRIMARY KEY (principal, client, sequence)
        )
        """,
        """
        INSERT INTO taskrpc_fleet (version, store_id, revision, record)
        VALUES (1, uuid_send(gen_random_uuid()), 0, '{}')
        """,
    ),
    (  # version 2: whether a commit took effect, and when a completion was stored
        """
        CREATE TABLE taskrpc_writer (
            writer text PRIMARY KEY, batch bigint NOT NULL,
            used_at timestamptz NOT NULL DEFAULT clock_timestamp()
        )
        """,
        """
        ALTER TABLE taskrpc_completion
        ADD COLUMN stored_at timestamptz NOT NULL DEFAULT clock_timestamp()
        """,
    ),
    # version 3: no other tables. Records of robots have fields that an earlier program would ignore
    # and lose, such as `paused`.
    (),
    (  # version 4: the archived tasks. `number` counts them, so that no removal needs a search
        """
        CREATE TABLE taskrpc_history (
            number bigint PRIMARY KEY, task_id bigint NOT NULL, ended_at float8 NOT NULL,
            record text NOT NULL
        )
        """,
        "CREATE INDEX taskrpc_history_ended ON taskrpc_history (ended_at, task_id)",
    ),
)
"""The statements that lead from each version to the next one. Released ones are never changed."""

VERSION = len(MIGRATIONS)
"""The version that this program writes and reads."""

_COLUMNS = (
    "SELECT version, store_id, revision, record FROM taskrpc_fleet LIMIT 0",
    "SELECT task_id, revision, state, robot, record FROM taskrpc_task LIMIT 0",
    "SELECT name, revision, lease_until, record FROM taskrpc_robot LIMIT 0",
    "SELECT principal, client, sequence, record, checksum, stored_at FROM taskrpc_completion"
    " LIMIT 0",
    "SELECT writer, batch, used_at FROM taskrpc_writer LIMIT 0",
    "SELECT number, task_id, ended_at, record FROM taskrpc_history LIMIT 0",
)
"""Statements that fail if a table of `VERSION` or a column is missing."""

_IS_MISSING = ("42P01", "42703")  # PostgreSQL's codes: no such table, no such column

TABLE_EXISTS = "SELECT to_regclass('taskrpc_fleet') IS NOT NULL"
"""A statement that returns whether the tables were created."""


async def prepare(connection: Connection, migrations: Sequence[Sequence[str]] = MIGRATIONS) -> None:
    """Create the tables, or upgrade them, in one transaction.

    Raises:
        StoreError: a newer program has upgraded them, or they lack a table or a column.
    """
    async with connection.transaction():
        # Servers that start together wait here for the first one.
        await connection.execute("SELECT pg_advisory_xact_lock(%s)", (_MIGRATION_LOCK,))
        version = 0
        found = await (await connection.execute(TABLE_EXISTS)).fetchone()
        if found is not None and found[0]:
            row = await (await connection.execute("SELECT version FROM taskrpc_fleet")).fetchone()
            if row is None:
                raise StoreError("the table taskrpc_fleet is empty: expected one row; restore it")
            version = row[0]
        check_version(version, len(migrations))
        for statements in migrations[version:]:
            for statement in statements:
                await connection.execute(statement)
        if version != len(migrations):
            await connection.execute("UPDATE taskrpc_fleet SET version = %s", (len(migrations),))
        if len(migrations) == VERSION:
            await _check_columns(connection)


async def _check_columns(connection: Connection) -> None:
    for statement in _COLUMNS:
        try:
            await connection.execute(statement)
        except FAILURES as error:
            if getattr(error, "sqlstate", "") not in _IS_MISSING:
                raise
            problem = str(error).partition("\n")[0]
            raise StoreError(
                f"the database says that it has the tables of version {VERSION}, but {problem};"
                " restore a backup, or use another database"
            ) from error


def check_version(found: int, expected: int = VERSION) -> None:
    """Raise StoreError if the tables have a newer version than this program knows."""
    if found > expected:
        raise StoreError(
            f"expected a task database of version {expected}, found version {found}:"
            " a newer taskrpc has upgraded it; install that version here"
        )
