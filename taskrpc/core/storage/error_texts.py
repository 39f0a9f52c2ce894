"""Turns errors of SQLite and the system into one sentence that names the file and the remedy."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from taskrpc.core.storage.records import Damaged
from taskrpc.errors import OutcomeUnknown, StoreError

_ABOUT_THE_FILE = frozenset(
    {
        sqlite3.SQLITE_PERM,
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_NOMEM,
        sqlite3.SQLITE_READONLY,
        sqlite3.SQLITE_IOERR,
        sqlite3.SQLITE_CORRUPT,
        sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_PROTOCOL,
        sqlite3.SQLITE_NOTADB,
    }
)


def is_full(error: BaseException) -> bool:
    """Return whether the disk was full."""
    return _primary_code(error) == sqlite3.SQLITE_FULL


def is_about_the_file(error: BaseException) -> bool:
    """Return whether the file is the cause, so that every change would have failed."""
    return _primary_code(error) in _ABOUT_THE_FILE


@contextlib.contextmanager
def store_errors(path: Path, *, except_statements: bool = False) -> Iterator[None]:
    """Raise a `StoreError` with the file's path for errors of the system, SQLite and the data.

    With `except_statements`, errors that a statement itself causes pass unchanged.
    """
    try:
        with _translated(path, except_statements=except_statements):
            yield
    except (StoreError, OutcomeUnknown) as error:
        real = path.resolve()
        error.files = (str(path), str(real), str(real.parent))
        raise


@contextlib.contextmanager
def _translated(path: Path, *, except_statements: bool) -> Iterator[None]:
    try:
        yield
    except StoreError as error:
        if str(path) in str(error):
            raise
        placed = StoreError(f"{path}: {error}")
        placed.for_callers = error.for_callers
        raise placed from error.__cause__
    except Damaged as damage:
        raise StoreError(_damage_text(path, damage)) from None
    except sqlite3.DatabaseError as error:
        if except_statements and not is_about_the_file(error):
            raise
        raise StoreError(_sqlite_text(path, error)) from error
    except OSError as error:
        raise StoreError(_system_text(path, error)) from error


def loss_text(path: Path, lock: Path, missing: int) -> str:
    """Return the text for a file that lacks `missing` transactions which its lock has counted."""
    last = "the last transaction" if missing == 1 else f"the last {missing} transactions"
    return (
        f"{path} lacks {last} that it had: {path.name}-wal beside it was removed or damaged, or the"
        f" file is an older copy; restore the files that belong together, or remove {lock} to go on"
        " without the missing transactions"
    )


def _system_text(path: Path, error: OSError) -> str:
    real = path.resolve()
    if isinstance(error, FileNotFoundError) and not real.parent.exists():
        return f"{path}: there is no folder {real.parent}"
    if real.is_dir():
        return f"{path}: expected a database, found a folder"
    at = "" if error.filename in (None, str(real)) else f"{error.filename}: "
    return f"{path}: the database cannot be opened: {at}{error.strerror}"


def _damage_text(path: Path, damage: Damaged) -> str:
    row, advice = "", f"or move {path}* away to start with an empty database"
    if damage.where:
        row = f", row {damage.where}"
        statement = f"DELETE FROM {damage.table} WHERE {damage.where}"
        advice = f'or delete the row: sqlite3 {path} "{statement}"'
    found = f"table {damage.table}{row}: {damage.problem}"
    return f"{path} is damaged ({found}); restore the file from a copy, {advice}"


def _sqlite_text(path: Path, error: sqlite3.DatabaseError) -> str:
    match _primary_code(error):
        case sqlite3.SQLITE_NOTADB:
            return f"{path}: expected a database, found another file"
        case sqlite3.SQLITE_FULL:
            return f"{path}: the disk is full; nothing was stored"
        case sqlite3.SQLITE_CORRUPT:
            advice = f"or move {path}* away to start with an empty database"
            return f"{path} is damaged ({error}); restore the file from a copy, {advice}"
    return f"{path}: the database cannot be used: {error}"


def _primary_code(error: BaseException) -> int:
    # The low byte is the primary code; the other bytes give details.
    return getattr(error, "sqlite_errorcode", 0) & 0xFF
