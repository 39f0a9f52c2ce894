"""The tables that every file has: the store's own row, and the completions of requests."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from taskrpc.request_ids.ids import Client, Completion
from taskrpc.storage.records import Damaged, read_records, with_checksum

_TABLES = (
    "CREATE TABLE taskrpc_store (store_id BLOB NOT NULL, commits INTEGER NOT NULL)",
    # Numbers have 64 bits without a sign, more than SQLite's: so they stand there in hexadecimal.
    """
    CREATE TABLE taskrpc_completion (
        principal TEXT NOT NULL, client TEXT NOT NULL, sequence TEXT NOT NULL,
        record TEXT NOT NULL, checksum INTEGER NOT NULL,
        PRIMARY KEY (principal, client, sequence)
    ) WITHOUT ROWID
    """,
)
# One statement a batch: each step of a statement takes the interpreter's lock from the event loop.
# For {} comes what has the rows, as JSON.
SAVE = """
    INSERT OR REPLACE INTO taskrpc_completion (principal, client, sequence, checksum, record)
    SELECT json_extract(value, '$[0]'), json_extract(value, '$[1]'), json_extract(value, '$[2]'),
           json_extract(value, '$[3]'), json_extract(value, '$[4]')
    FROM json_each({})
"""
SETTLE = """
    DELETE FROM taskrpc_completion WHERE (principal, client, sequence) IN (
        SELECT found.principal, found.client, found.sequence
        FROM json_each({}) AS settled CROSS JOIN taskrpc_completion AS found
        ON found.principal = json_extract(settled.value, '$[0]')
        AND found.client = json_extract(settled.value, '$[1]')
        AND found.sequence < json_extract(settled.value, '$[2]')
    )
"""
FORGET = """
    DELETE FROM taskrpc_completion WHERE (principal, client, sequence) IN (
        SELECT found.principal, found.client, found.sequence
        FROM json_each({}) AS forgotten CROSS JOIN taskrpc_completion AS found
        ON found.principal = json_extract(forgotten.value, '$[0]')
        AND found.client = json_extract(forgotten.value, '$[1]')
    )
"""


def has_tables(connection: sqlite3.Connection) -> bool:
    """Whether a file is a store already."""
    found = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'taskrpc_store'")
    return found.fetchone() is not None


def make_tables(connection: sqlite3.Connection) -> None:
    """Make the tables of a new store, in the transaction that is open."""
    for statement in _TABLES:
        connection.execute(statement)
    connection.execute("INSERT INTO taskrpc_store VALUES (?, 0)", (os.urandom(16),))


def renew(connection: sqlite3.Connection) -> None:
    """Forget everything and become another store, in the transaction that is open."""
    connection.execute("DELETE FROM taskrpc_completion")
    connection.execute("UPDATE taskrpc_store SET store_id = ?", (os.urandom(16),))


def read_store_id(connection: sqlite3.Connection) -> bytes:
    """Return the store's id. Raises Damaged."""
    found = connection.execute("SELECT store_id FROM taskrpc_store").fetchone()
    if found is None or not isinstance(found[0], bytes) or len(found[0]) != 16:
        raise Damaged("taskrpc_store", "expected the store's id of 16 bytes")
    return found[0]


def read_completions(connection: sqlite3.Connection) -> tuple[Completion, ...]:
    """Return every completion. Raises Damaged."""
    rows = connection.execute(
        "SELECT client, sequence, record, checksum FROM taskrpc_completion"
    ).fetchall()
    found = read_records(rows, Completion, "taskrpc_completion", "client", "sequence")
    # A page that stands where another belongs has rows whose checksums are right.
    keys = [(each.principal.encode(), each.client, each.sequence) for each in found]
    if any(key >= following for key, following in pairwise(keys)):
        raise Damaged("taskrpc_completion", "the rows are not in their order")
    return tuple(found)


class CompletionBatch:
    """What happens to the completions of a store in one transaction, in the order of the calls."""

    def __init__(self) -> None:
        self._saved: dict[Client, dict[int, Completion]] = {}
        self._forgotten: dict[Client, None] = {}

    def add(self, completion: Completion | None, forgotten: Sequence[Client]) -> None:
        """Forget clients, then remember a completion, if there is one."""
        for client in forgotten:
            self._saved.pop(client, None)
            self._forgotten[client] = None
        if completion is not None:
            client = (completion.principal, completion.client)
            self._saved.setdefault(client, {})[completion.sequence] = completion

    def rows(self) -> tuple[str, str, str]:
        """What `FORGET`, `SAVE` and `SETTLE` are to be given, in this order."""
        forgotten = [(principal, client.hex()) for principal, client in self._forgotten]
        saved, settled = [], []
        for (principal, client), known in self._saved.items():
            saved += [_row(each) for each in known.values()]
            first = max(each.first_incomplete for each in known.values())
            settled.append((principal, client.hex(), _number(first)))
        return as_json(forgotten), as_json(saved), as_json(settled)

    def write(self, connection: sqlite3.Connection) -> None:
        """Carry it out in the transaction that is open."""
        for statement, rows in zip((FORGET, SAVE, SETTLE), self.rows(), strict=True):
            if rows != "[]":
                connection.execute(statement.format("?"), (rows,))


def as_json(rows: Sequence[object]) -> str:
    """Rows as a statement takes them."""
    return msgspec.json.encode(rows).decode()


def _row(completion: Completion) -> tuple[str, str, str, int, str]:
    client, number = completion.client.hex(), _number(completion.sequence)
    record = msgspec.json.encode(completion)
    return completion.principal, client, number, *with_checksum(record, client, number)


def _number(sequence: int) -> str:
    return f"{sequence:016x}"
