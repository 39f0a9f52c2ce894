"""The completions of a store: an index in memory, and a table in an SQLite file.

Both forget the completions that a client has settled: those of its requests below the first
sequence number for which it still waits.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import msgspec

from taskrpc.core.request_ids.ids import ClientKey, Completion
from taskrpc.core.storage.records import Damaged, read_records, with_checksum

if TYPE_CHECKING:
    import sqlite3

_BATCH_SIZE = 64
"""Completions that are gathered before they enter the index."""
_LARGE = 4096
"""Bytes of a response that enters the index at once, so that it can be forgotten soon."""

_TABLE = """
    CREATE TABLE taskrpc_completion (
        principal TEXT NOT NULL, client TEXT NOT NULL, sequence TEXT NOT NULL,
        record TEXT NOT NULL, checksum INTEGER NOT NULL,
        PRIMARY KEY (principal, client, sequence)
    ) WITHOUT ROWID
"""
# Sequence numbers are unsigned 64-bit integers, which SQLite does not have: the table holds them in
# hexadecimal.

# One statement for each batch: every step of a statement takes the interpreter's lock from the
# event loop. The braces stand for the expression that holds the rows as JSON.
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


class CompletionIndex:
    """Completions in memory, by client and sequence number."""

    def __init__(self) -> None:
        self._by_client: dict[ClientKey, dict[int, Completion]] = {}
        self._last: Completion | None = None
        """The latest completion. The next one settles it if a client calls again and again: then
        its memory is used again while the processor has it in its cache."""
        self._recent: list[Completion] = []
        """Those before it that are not indexed yet: the next completions of the same client settle
        most of them, and those are never indexed."""

    def all(self) -> tuple[Completion, ...]:
        """Return every completion that is not settled."""
        self._index_recent()
        return tuple(each for known in self._by_client.values() for each in known.values())

    def add(self, completion: Completion | None, forgotten: Sequence[ClientKey] = ()) -> None:
        """Forget clients, then add a completion and forget those that it settles."""
        if forgotten:
            self._index_recent()
            for client in forgotten:
                self._by_client.pop(client, None)
        if completion is not None:
            last, self._last = self._last, completion
            if last is not None and (
                last.sequence >= completion.first_incomplete
                or last.client != completion.client
                or last.principal != completion.principal
            ):
                recent = self._recent
                recent.append(last)
                if len(recent) >= _BATCH_SIZE or len(last.response) >= _LARGE:
                    self._index_recent()

    def _index_recent(self) -> None:
        recent, self._recent = self._recent, []
        if self._last is not None:
            recent.append(self._last)
            self._last = None
        firsts: dict[ClientKey, int] = {}
        unsettled: list[Completion] = []
        principal, client, first = "", b"", 0
        for completion in reversed(recent):
            same = completion.client == client and completion.principal == principal
            if same and completion.sequence < first:  # the usual case
                continue
            principal, client = key = completion.principal, completion.client
            first = firsts.get(key, 0)
            if completion.first_incomplete > first:
                first = firsts[key] = completion.first_incomplete
            elif completion.sequence < first:
                continue
            unsettled.append(completion)
        for key, first in firsts.items():
            known = self._by_client.setdefault(key, {})
            for each in known.values():  # an earlier batch may have settled more
                if each.first_incomplete > first:
                    first = firsts[key] = each.first_incomplete  # noqa: PLW2901
            for sequence in [each for each in known if each < first]:
                del known[sequence]
        for completion in reversed(unsettled):
            key = completion.principal, completion.client
            if completion.sequence >= firsts[key]:
                self._by_client[key][completion.sequence] = completion


def create_completion_table(connection: sqlite3.Connection) -> None:
    """Create the table of a new store, in the open transaction."""
    connection.execute(_TABLE)


def delete_completions(connection: sqlite3.Connection) -> None:
    """Delete all completions, in the open transaction."""
    connection.execute("DELETE FROM taskrpc_completion")


def read_completions(connection: sqlite3.Connection) -> tuple[Completion, ...]:
    """Return every completion in the table. Raises Damaged."""
    rows = connection.execute(
        "SELECT client, sequence, record, checksum FROM taskrpc_completion"
    ).fetchall()
    found = read_records(rows, Completion, "taskrpc_completion", "client", "sequence")
    # If SQLite reads one page in the place of another, the checksums of its rows are still right.
    keys = [(each.principal.encode(), each.client, each.sequence) for each in found]
    if any(key >= following for key, following in pairwise(keys)):
        raise Damaged("taskrpc_completion", "the rows are not in their order")
    return tuple(found)


class CompletionBatch:
    """The changes of a completion table in one transaction, in the order of the calls."""

    def __init__(self) -> None:
        self._saved: dict[ClientKey, dict[int, Completion]] = {}
        self._forgotten: dict[ClientKey, None] = {}

    def add(self, completion: Completion | None, forgotten: Sequence[ClientKey]) -> None:
        """Forget clients, then add a completion if there is one."""
        for client in forgotten:
            self._saved.pop(client, None)
            self._forgotten[client] = None
        if completion is not None:
            client = (completion.principal, completion.client)
            self._saved.setdefault(client, {})[completion.sequence] = completion

    def rows(self) -> tuple[str, str, str]:
        """Return the rows for `FORGET`, `SAVE` and `SETTLE`, in this order, as JSON."""
        forgotten = [(principal, client.hex()) for principal, client in self._forgotten]
        saved, settled = [], []
        for (principal, client), known in self._saved.items():
            saved += [_row(each) for each in known.values()]
            first = max(each.first_incomplete for each in known.values())
            settled.append((principal, client.hex(), _hexadecimal(first)))
        return as_json(forgotten), as_json(saved), as_json(settled)

    @staticmethod
    def sql(forgotten: str, saved: str, settled: str) -> str:
        """Return the SQL that writes `rows`; each argument is the expression that holds one."""
        return ";".join((FORGET.format(forgotten), SAVE.format(saved), SETTLE.format(settled)))

    def write(self, connection: sqlite3.Connection) -> None:
        """Write the changes in the open transaction."""
        for statement, rows in zip((FORGET, SAVE, SETTLE), self.rows(), strict=True):
            if rows != "[]":
                connection.execute(statement.format("?"), (rows,))


def as_json(rows: Sequence[object]) -> str:
    """Encode rows as the statements above expect them."""
    return msgspec.json.encode(rows).decode()


def _row(completion: Completion) -> tuple[str, str, str, int, str]:
    client, sequence = completion.client.hex(), _hexadecimal(completion.sequence)
    record = msgspec.json.encode(completion)
    return completion.principal, client, sequence, *with_checksum(record, client, sequence)


def _hexadecimal(sequence: int) -> str:
    return f"{sequence:016x}"
