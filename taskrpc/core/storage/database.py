"""One SQLite file that one process uses: opens it, changes it in transactions, closes it.

A COMMIT that fails may take effect all the same: its data is in the system's memory and may reach
the disk later. So after a failed COMMIT, the file is opened again and read. If it cannot be read,
the outcome is unknown, and the file is not used again before it is closed.

Data written to a removed file would be lost at the end of this process, and a log is worth nothing
without the file that belongs to it. So each change first checks that the path still leads to the
open file, and that only this program has written to the file and its log.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sqlite3
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from taskrpc.core.storage import path_checks
from taskrpc.core.storage.error_texts import is_about_the_file, is_full, loss_text, store_errors
from taskrpc.core.storage.file_watch import FileWatch
from taskrpc.core.storage.lock import CommitCount, Lock
from taskrpc.core.storage.records import Damaged
from taskrpc.core.system import private_files
from taskrpc.core.transport.chance import present_chance
from taskrpc.errors import OutcomeUnknown, StoreError

_Result = TypeVar("_Result")
_Work = Callable[[sqlite3.Connection], None]

_STORE_TABLE = "CREATE TABLE taskrpc_store (store_id BLOB NOT NULL, commits INTEGER NOT NULL)"


def has_store(connection: sqlite3.Connection) -> bool:
    """Return whether a database contains a store."""
    found = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'taskrpc_store'")
    return found.fetchone() is not None


def create_store(connection: sqlite3.Connection) -> None:
    """Create the table that holds a new store's id and count of commits, in the open transaction.

    Every file that a `Database` opens must have this table.
    """
    connection.execute(_STORE_TABLE)
    connection.execute("INSERT INTO taskrpc_store VALUES (?, 0)", (present_chance().randbytes(16),))


def replace_store_id(connection: sqlite3.Connection) -> None:
    """Give the store a new id, in the open transaction, so that clients see a different store."""
    connection.execute("UPDATE taskrpc_store SET store_id = ?", (present_chance().randbytes(16),))


def read_store_id(connection: sqlite3.Connection) -> bytes:
    """Return the store's id, 16 bytes. Raises Damaged."""
    found = connection.execute("SELECT store_id FROM taskrpc_store").fetchone()
    if found is None or not isinstance(found[0], bytes) or len(found[0]) != 16:
        raise Damaged("taskrpc_store", "expected the store's id of 16 bytes")
    return found[0]


class Database:
    """The open file; all calls must come from one thread.

    Args:
        path: the database file; created if it does not exist. A file `<path>.lock` beside it says
            which process uses it.
        prepare: creates missing tables, in a transaction, or refuses the file.
        equip: sets up each new connection, for example with temporary tables.
        holder: the kind of program that uses such a file, for error texts.
        clearing: whether to accept a missing or incomplete store, because everything will be
            deleted.

    Raises:
        StoreError: it cannot be opened.
    """

    def __init__(
        self, path: Path, prepare: _Work, equip: _Work, *, holder: str, clearing: bool = False
    ) -> None:
        self._path = path
        self._equip = equip
        self._why_broken = ""
        """Why the file cannot be used any more, "" while it can."""
        with contextlib.ExitStack() as undo, store_errors(path):
            path_checks.refuse_strangers(path)
            path_checks.refuse_second_name(path)
            self._lock = Lock(path, holder)
            undo.callback(self._lock.close)
            if not clearing:  # before SQLite can delete the log
                path_checks.refuse_lost_store(path.resolve(), self._lock)
            _create_private(path.resolve())
            self._connection = _connect(path)
            undo.callback(self._disconnect)
            if not clearing:
                self._refuse_other_contents()
            self._prepare(prepare)
            _make_private(path.resolve())
            self._connection.execute("PRAGMA journal_mode = WAL")
            equip(self._connection)
            self._reached = self._count()
            """The count of commits after the last change."""
            self._taken = self._reached.commits
            """The number of the last attempt at a change.

            Each attempt takes another one, so that the check of a failed COMMIT never finds that of
            an earlier attempt.
            """
            if not clearing:
                self._refuse_loss()
            self._note(self._reached)
            self._watch = FileWatch(path)
            self._undo = undo.pop_all()

    @property
    def is_broken(self) -> bool:
        """Whether the only possible call is `close`, because an outcome is unknown."""
        return bool(self._why_broken)

    def read(self, work: Callable[[sqlite3.Connection], _Result]) -> _Result:
        """Return the result of a function that reads the file. Raises StoreError."""
        with store_errors(self._path):
            self._check()
            return work(self._connection)

    def change(self, work: _Work) -> None:
        """Run a function in a transaction; its changes are on the disk when this returns.

        Raises:
            StoreError: nothing was changed.
            OutcomeUnknown: the change may have been made; the database is broken.
            Exception: `work` raised it, and nothing was changed.
        """
        self._do(lambda number: self._in_transaction(work, number))
        with contextlib.suppress(sqlite3.Error):  # the change itself was made
            self._note(self._count())  # `work` may have given the store a new id

    def change_at_once(self, statement: str, values: Sequence[Any]) -> None:
        """Do the same as `change`, with one statement that is the whole transaction.

        It takes the interpreter's lock only once; on a busy event loop, waiting for that lock takes
        most of the time. The statement must write its last parameter as `commits`.
        """
        self._do(lambda number: _execute(self._connection, statement, (*values, number)))

    def _do(self, transaction: Callable[[int], None]) -> None:
        with store_errors(self._path, except_statements=True):
            self._check()
            self._check_path()
            number = self._take_number()
            try:
                self._with_room(transaction, number)
                self._note(CommitCount(self._reached.store_id, number))
            except _CommitFailed as failed:
                self._find_out(number, failed.error)
            finally:
                if (seen := self._watch.note()) and not self._why_broken:
                    self._why_broken = f"{seen.fact}, so a change may be lost; {seen.remedy}"
            if self._why_broken:
                raise OutcomeUnknown(self._why_broken)

    def _take_number(self) -> int:
        self._taken += 1
        return self._taken

    def _with_room(self, transaction: Callable[[int], None], number: int) -> None:
        try:
            transaction(number)
        except sqlite3.Error as error:
            if not is_full(error) or not self._can_write_log_anew():
                raise
            transaction(number)

    def _can_write_log_anew(self) -> bool:
        """Move the log's contents into the file; return whether the log's space is free again."""
        try:
            busy, *_ = self._connection.execute("PRAGMA wal_checkpoint(RESTART)").fetchone()
        except sqlite3.Error:  # there is no space for the file either
            return False
        return not busy

    def _note(self, reached: CommitCount) -> None:
        self._reached = reached
        self._lock.note(reached)

    def close(self) -> None:
        """Write everything into the one file and release its lock."""
        self._undo.close()

    def _disconnect(self) -> None:
        with contextlib.suppress(sqlite3.Error):
            self._connection.close()

    def _prepare(self, prepare: _Work) -> None:
        try:
            self._in_transaction(prepare)
        except _CommitFailed as failed:
            raise failed.error from None

    def _refuse_loss(self) -> None:
        """Refuse a file that lacks transactions which its lock has counted."""
        known, reached = self._lock.commit_count or self._reached, self._reached
        if known.store_id == reached.store_id and known.commits > reached.commits:
            raise StoreError(
                loss_text(self._path, self._lock.path, known.commits - reached.commits)
            )

    def _refuse_other_contents(self) -> None:
        """Refuse a database without tables if the lock has, or may have, counted transactions."""
        if self._lock.may_have_commits and not has_store(self._connection):
            text = path_checks.lost_store(self._path.resolve(), self._lock, "holds no store")
            raise StoreError(text)

    def _check(self) -> None:
        if self._why_broken:
            raise StoreError(self._why_broken)

    def _check_path(self) -> None:
        if self._lock.is_lost and self._path.exists():  # else the whole folder was moved
            raise StoreError(
                f"{self._path}: its lock {self._lock.path.name} was removed, so another server may"
                " use the file; nothing was stored; start this server again"
            )
        if seen := self._watch.tampering():
            raise StoreError(f"{seen.fact}; nothing was stored; {seen.remedy}")

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
        """Find out whether a failed COMMIT took effect: return if it did, else raise the error."""
        try:
            self._disconnect()
            self._connection = _connect(self._path)
            self._equip(self._connection)
            was_done = self._count().commits == number
            # Reading shows the data in the system's memory, which may not be on the disk. Write it
            # again, over any older data that a failure of the machine would bring back.
            self._empty_log()
            self._in_transaction(lambda _: None, self._take_number())
            self._note(self._count())
            self._watch = FileWatch(self._path)
        except (sqlite3.Error, OSError, _CommitFailed) as second:
            self._why_broken = (
                f"{self._path} cannot be used any more, because writing to it failed ({error}) and "
                f"opening it again failed ({second}); repair the disk, then start the server again"
            )
            raise OutcomeUnknown(self._why_broken) from error
        if not was_done:
            text = f"{self._path}: writing to it failed ({error}); nothing was stored"
            raise StoreError(text) from error

    def _empty_log(self) -> None:
        busy, *_ = self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        if busy:
            raise sqlite3.OperationalError("another program reads it")

    def _count(self) -> CommitCount:
        found = self._connection.execute("SELECT store_id, commits FROM taskrpc_store").fetchone()
        store_id, commits = found or (b"", 0)
        if not isinstance(store_id, bytes) or not isinstance(commits, int):
            return CommitCount(b"", 0)  # `read_store_id` reports the damage
        return CommitCount(store_id, commits)


class MemoryDatabase:
    """A database in memory with the methods of `Database`; its contents last until `close`.

    Args:
        prepare, equip: as for `Database`.

    Raises:
        Exception: `prepare` raised it.
    """

    is_broken = False
    """A database in memory is never broken."""

    def __init__(self, prepare: _Work, equip: _Work) -> None:
        # Event loops in different threads may use the store one after the other.
        self._connection = _connect(":memory:", check_same_thread=False)
        weakref.finalize(self, self._connection.close)  # Python 3.13 warns if it stays open
        try:
            self.change(prepare)
        except BaseException:
            self.close()
            raise
        equip(self._connection)

    def read(self, work: Callable[[sqlite3.Connection], _Result]) -> _Result:
        """Return the result of a function that reads the database. Raises StoreError."""
        try:
            return work(self._connection)
        except sqlite3.Error as error:
            raise StoreError(str(error)) from error

    def change(self, work: _Work) -> None:
        """Run a function in a transaction. Raises its error after a rollback."""
        with self._connection as connection:
            connection.execute("BEGIN")
            work(connection)

    def close(self) -> None:
        """Close the connection, which deletes everything."""
        self._connection.close()


class _CommitFailed(Exception):
    """COMMIT raised `error`, and may have taken effect or not."""

    def __init__(self, error: sqlite3.Error) -> None:
        self.error = error
        super().__init__(str(error))


def _execute(connection: sqlite3.Connection, ending: str, values: Sequence[Any] = ()) -> None:
    """Run the statement that ends a transaction.

    Raises _CommitFailed if the transaction may have taken effect in spite of the error.
    """
    try:
        connection.execute(ending, values)
    except sqlite3.Error as error:
        # On a full disk, SQLite did not complete the transaction's last page, which makes it valid.
        if is_full(error) or not is_about_the_file(error):
            raise
        raise _CommitFailed(error) from error


def _connect(path: Path | str, *, check_same_thread: bool = True) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None, check_same_thread=check_same_thread)
    # Text in a damaged file may not be valid UTF-8.
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
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    # SQLite opens a read-only file too, and fails only at the first change.
    if not os.access(path, os.R_OK | os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


def _make_private(path: Path) -> None:
    """Let only this user read the file; SQLite gives the files beside it the same permissions."""
    # Do not use a descriptor: closing it would drop the locks of other readers in this process.
    for suffix in path_checks.SIDE_FILES:
        with contextlib.suppress(FileNotFoundError):
            private_files.set_mode(path.with_name(path.name + suffix), 0o600)
