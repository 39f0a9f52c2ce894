"""Checks the tables of a database when it is opened: every change would fail on other tables."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable

from taskrpc.errors import StoreError


def refuse_other_tables(
    connection: sqlite3.Connection, create: Callable[[sqlite3.Connection], object]
) -> None:
    """Refuse a database whose tables differ from those that `create` makes; others do not matter.

    Raises:
        StoreError: a table is missing, or has other columns.
    """
    with contextlib.closing(sqlite3.connect(":memory:")) as model:
        create(model)
        for (table,) in model.execute("SELECT name FROM sqlite_master WHERE type = 'table'"):
            expected, found = _columns(model, table), _columns(connection, table)
            if found == expected:
                continue
            was = f"found ({', '.join(found)})" if found else "it is missing"
            raise StoreError(
                f"the table {table} is not the one that taskrpc writes: expected"
                f" ({', '.join(expected)}), {was}; restore a copy, or use another file"
            )


def _columns(connection: sqlite3.Connection, table: str) -> list[str]:
    """Return each column with its type and limits."""
    found = connection.execute(
        'SELECT name, type, "notnull", pk, coalesce(dflt_value, ?) FROM pragma_table_info(?)',
        ("", table),
    )
    return [_described(*row) for row in found]


def _described(name: str | bytes, kind: str | bytes, required: int, key: int, default: str) -> str:
    parts = [_text(name), _text(kind), "NOT NULL" if required else "", f"key {key}" if key else ""]
    return " ".join(part for part in (*parts, _text(default)) if part)


def _text(value: str | bytes) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else value
