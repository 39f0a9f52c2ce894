"""What SQLite and the system say about a file, as one sentence that names the file."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.storage.records import Damaged

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
    """Whether there was no room on the disk."""
    return _primary_code(error) == sqlite3.SQLITE_FULL


def is_about_the_file(error: BaseException) -> bool:
    """Whether anybody's change would have failed, not just this one."""
    return _primary_code(error) in _ABOUT_THE_FILE


@contextlib.contextmanager
def plainly(path: Path, *, but_statements: bool = False) -> Iterator[None]:
    """Turn what can go wrong with a file into a `StoreError`.

    With `but_statements`, what is wrong with a statement itself is left to the caller.
    """
    try:
        with _in_words(path, but_statements=but_statements):
            yield
    except (StoreError, OutcomeUnknown) as error:
        place = path.resolve()
        error.files = (str(path), str(place), str(place.parent))
        raise


@contextlib.contextmanager
def _in_words(path: Path, *, but_statements: bool) -> Iterator[None]:
    try:
        yield
    except StoreError as error:
        if str(path) in str(error):
            raise
        placed = StoreError(f"{path}: {error}")
        placed.for_callers = error.for_callers
        raise placed from error.__cause__
    except Damaged as damage:
        raise StoreError(_of_damage(path, damage)) from None
    except sqlite3.DatabaseError as error:
        if but_statements and not is_about_the_file(error):
            raise
        raise StoreError(_of_file(path, error)) from error
    except OSError as error:
        raise StoreError(_of_system(path, error)) from error


def loss(path: Path, lock: Path, missing: int) -> str:
    """What is said of a file that lacks `missing` transactions which its lock has counted."""
    last = "the last transaction" if missing == 1 else f"the last {missing} transactions"
    return (
        f"{path} lacks {last} that it had: {path.name}-wal beside it was removed or damaged, or the"
        f" file is an older copy; bring back what belongs together, or remove {lock} to go on"
        " without what is missing"
    )


def _of_system(path: Path, error: OSError) -> str:
    place = path.resolve()
    if isinstance(error, FileNotFoundError) and not place.parent.exists():
        return f"{path}: there is no folder {place.parent}"
    if place.is_dir():
        return f"{path}: expected a database, found a folder"
    at = "" if error.filename in (None, str(place)) else f"{error.filename}: "
    return f"{path}: the database cannot be opened: {at}{error.strerror}"


def _of_damage(path: Path, damage: Damaged) -> str:
    row, advice = "", f"or move {path}* away to start with an empty database"
    if damage.where:
        row = f", row {damage.where}"
        statement = f"DELETE FROM {damage.table} WHERE {damage.where}"
        advice = f'or give the row up: sqlite3 {path} "{statement}"'
    found = f"table {damage.table}{row}: {damage.problem}"
    return f"{path} is damaged ({found}); restore the file from a copy, {advice}"


def _of_file(path: Path, error: sqlite3.DatabaseError) -> str:
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
    # The low byte; the others say more about the same.
    return getattr(error, "sqlite_errorcode", 0) & 0xFF
