"""One SQLite file in the hands of one process: opened, changed in transactions, closed.

A COMMIT that fails may have been done all the same: what it wrote is in the system's memory, and
may reach the disk later. So the file is then opened anew and read, which tells; if it cannot be,
nobody here can know, and the file is not touched again before it is closed.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.storage.lock import held
from taskrpc.storage.sentences import is_about_the_file, is_full, plainly

_SIDE_FILES = ("", "-wal", "-shm")
_Result = TypeVar("_Result")
_Work = Callable[[sqlite3.Connection], None]


class Database:
    """The open file; every call from one thread.

    Args:
        path: the database file; made if it is not there. A file `<path>.lock` beside it says
            which process uses it.
        prepare: makes the tables that a file lacks, in a transaction, or refuses the file.
        equip: gives a connection what it needs besides tables, whenever there is a new one.
        holder: what uses such a file, as a sentence names it.

    Raises:
        StoreError: it cannot be opened.
    """

    def __init__(self, path: Path, prepare: _Work, equip: _Work, *, holder: str) -> None:
        self._path = path
        self._equip = equip
        self._why_broken = ""
        with contextlib.ExitStack() as undo, plainly(path):
            undo.enter_context(held(path, holder))
            _create_private(path.resolve())
            self._connection = _connect(path)
            undo.callback(self._disconnect)
            self._prepare(prepare)
            _make_private(path.resolve())
            self._connection.execute("PRAGMA journal_mode = WAL")
            equip(self._connection)
            self._commits = self._count()
            self._undo = undo.pop_all()

    @property
    def is_broken(self) -> bool:
        """Whether nothing more can be done with it, except to close it."""
        return bool(self._why_broken)

    def read(self, work: Callable[[sqlite3.Connection], _Result]) -> _Result:
        """Look something up. Raises StoreError."""
        with plainly(self._path):
            self._check()
            return work(self._connection)

    def change(self, work: _Work) -> None:
        """Do all of it or nothing of it; it is on the disk when this returns.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: nobody knows whether it was; the database is broken.
            Exception: `work` raised it itself, and nothing was changed.
        """
        self._do(lambda number: self._in_transaction(work, number))

    def change_at_once(self, statement: str, values: Sequence[Any]) -> None:
        """Do as `change` does, by one statement that is the whole transaction.

        It takes the interpreter's lock once instead of at each of many steps, and on a busy loop
        that is what takes time. Its last parameter is what it must write as `commits`.
        """
        self._do(lambda number: _execute(self._connection, statement, (*values, number)))

    def _do(self, transaction: Callable[[int], None]) -> None:
        with plainly(self._path, but_statements=True):
            self._check()
            number = self._commits + 1
            try:
                transaction(number)
                self._commits = number
            except _CommitFailed as failed:
                self._find_out(number, failed.error)

    def close(self) -> None:
        """Write everything into the one file and let others use it."""
        self._undo.close()

    def _disconnect(self) -> None:
        with contextlib.suppress(sqlite3.Error):
            self._connection.close()

    def _prepare(self, prepare: _Work) -> None:
        try:
            self._in_transaction(prepare)
        except _CommitFailed as failed:
            raise failed.error from None

    def _check(self) -> None:
        if self._why_broken:
            raise StoreError(self._why_broken)

    def _in_transaction(self, work: _Work, number: int = 0) -> None:
        connection = self._connection
        connection.execute("BEGIN IMMEDIATE")
        try:
            work(connection)
            if number:
                connection.execute("UPDATE taskrpc_store SET commits = ?", (number,))
            _execute(connection, "COMMIT")
        except BaseException:
            if connection.in_transaction:
                with contextlib.suppress(sqlite3.Error):
                    connection.execute("ROLLBACK")
            raise

    def _find_out(self, number: int, error: sqlite3.Error) -> None:
        """After a COMMIT that failed: return if it was done all the same, else raise why not."""
        try:
            self._disconnect()
            self._connection = _connect(self._path)
            self._equip(self._connection)
            was_done = self._count() == number
            # Reading shows what the system remembers, be it on the disk or not. This writes it
            # anew, and writes over what would come to light again if the machine failed now.
            self._empty_log()
            self._in_transaction(lambda _: None, self._count() + 1)
            self._commits = self._count()
        except (sqlite3.Error, OSError, _CommitFailed) as second:
            self._why_broken = (
                f"{self._path} cannot be used any more, since writing to it failed ({error}) and "
                f"so did opening it again ({second}); mend the disk, then start the server again"
            )
            raise OutcomeUnknown(self._why_broken) from error
        if not was_done:
            text = f"{self._path}: writing to it failed ({error}); nothing was stored"
            raise StoreError(text) from error

    def _empty_log(self) -> None:
        busy, *_ = self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        if busy:
            raise sqlite3.OperationalError("another program reads it")

    def _count(self) -> int:
        found = self._connection.execute("SELECT commits FROM taskrpc_store").fetchone()
        return found[0] if found is not None and isinstance(found[0], int) else 0


class _CommitFailed(Exception):
    """COMMIT raised `error`, and may have been done or not."""

    def __init__(self, error: sqlite3.Error) -> None:
        self.error = error
        super().__init__(str(error))


def _execute(connection: sqlite3.Connection, ending: str, values: Sequence[Any] = ()) -> None:
    """Do what ends a transaction. Raises _CommitFailed where it may have ended it all the same."""
    try:
        connection.execute(ending, values)
    except sqlite3.Error as error:
        # On a full disk the page that makes a transaction valid, its last, was not written whole.
        if is_full(error) or not is_about_the_file(error):
            raise
        raise _CommitFailed(error) from error


def pragma(connection: sqlite3.Connection, name: str) -> int:
    """A number that SQLite keeps in the file's head."""
    value: int = connection.execute(f"PRAGMA {name}").fetchone()[0]
    return value


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None)
    # What a damaged file holds need not be text.
    connection.text_factory = bytes
    try:
        connection.execute("PRAGMA synchronous = FULL")
    except BaseException:
        connection.close()
        raise
    return connection


def _create_private(path: Path) -> None:
    with contextlib.suppress(FileExistsError):
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600))


def _make_private(path: Path) -> None:
    """Let nobody else read the file; SQLite gives those that it makes beside it the same rights."""
    # Not through a descriptor: closing one would drop the locks of other readers in this process.
    for suffix in _SIDE_FILES:
        with contextlib.suppress(FileNotFoundError):
            path.with_name(path.name + suffix).chmod(0o600)
