"""One SQLite file in the hands of one process: opened, changed in transactions, closed.

A COMMIT that fails may have been done all the same: what it wrote is in the system's memory, and
may reach the disk later. So the file is then opened anew and read, which tells; if it cannot be,
nobody here can know, and the file is not touched again before it is closed.

What is written to a file that was removed meanwhile is lost with this process, so its place is
looked at before each change.
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

from taskrpc import platform
from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.storage import path_checks
from taskrpc.storage.error_texts import is_about_the_file, is_full, loss, plainly
from taskrpc.storage.lock import Lock, Witness
from taskrpc.storage.records import Damaged

_Result = TypeVar("_Result")
_Work = Callable[[sqlite3.Connection], None]

_STORE_TABLE = "CREATE TABLE taskrpc_store (store_id BLOB NOT NULL, commits INTEGER NOT NULL)"


def has_store(connection: sqlite3.Connection) -> bool:
    """Whether a database holds a store already."""
    found = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'taskrpc_store'")
    return found.fetchone() is not None


def create_store(connection: sqlite3.Connection) -> None:
    """Create the table that holds a new store's id and count of commits, in the open transaction.

    Every file that a `Database` opens must have this table.
    """
    connection.execute(_STORE_TABLE)
    connection.execute("INSERT INTO taskrpc_store VALUES (?, 0)", (os.urandom(16),))


def replace_store_id(connection: sqlite3.Connection) -> None:
    """Give the store a new id, in the open transaction, so that clients take it for another one."""
    connection.execute("UPDATE taskrpc_store SET store_id = ?", (os.urandom(16),))


def read_store_id(connection: sqlite3.Connection) -> bytes:
    """Return the store's id, 16 bytes. Raises Damaged."""
    found = connection.execute("SELECT store_id FROM taskrpc_store").fetchone()
    if found is None or not isinstance(found[0], bytes) or len(found[0]) != 16:
        raise Damaged("taskrpc_store", "expected the store's id of 16 bytes")
    return found[0]


class Database:
    """The open file; every call from one thread.

    Args:
        path: the database file; made if it is not there. A file `<path>.lock` beside it says
            which process uses it.
        prepare: makes the tables that a file lacks, in a transaction, or refuses the file.
        equip: gives a connection what it needs besides tables, whenever there is a new one.
        holder: what uses such a file, as a sentence names it.
        anew: whether a store that is missing, or lacks transactions, does not matter, because
            everything is going to be deleted.

    Raises:
        StoreError: it cannot be opened.
    """

    def __init__(
        self, path: Path, prepare: _Work, equip: _Work, *, holder: str, anew: bool = False
    ) -> None:
        self._path = path
        self._equip = equip
        self._why_broken = ""
        with contextlib.ExitStack() as undo, plainly(path):
            path_checks.refuse_strangers(path)
            path_checks.refuse_second_name(path)
            self._lock = Lock(path, holder)
            undo.callback(self._lock.close)
            if not anew:  # before SQLite can delete the log
                path_checks.refuse_lost_store(path.resolve(), self._lock)
            _create_private(path.resolve())
            self._connection = _connect(path)
            undo.callback(self._disconnect)
            if not anew:
                self._refuse_other_contents()
            self._prepare(prepare)
            _make_private(path.resolve())
            self._connection.execute("PRAGMA journal_mode = WAL")
            equip(self._connection)
            self._file = path.stat()
            self._reached = self._count()
            if not anew:
                self._refuse_loss()
            self._note(self._reached)
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
        with contextlib.suppress(sqlite3.Error):  # what is done is done
            self._note(self._count())  # it may be another store now

    def change_at_once(self, statement: str, values: Sequence[Any]) -> None:
        """Do as `change` does, by one statement that is the whole transaction.

        It takes the interpreter's lock once instead of at each of many steps, and on a busy loop
        that is what takes time. Its last parameter is what it must write as `commits`.
        """
        self._do(lambda number: _execute(self._connection, statement, (*values, number)))

    def _do(self, transaction: Callable[[int], None]) -> None:
        with plainly(self._path, but_statements=True):
            self._check()
            self._check_place()
            number = self._reached.commits + 1
            try:
                self._with_room(transaction, number)
                self._note(Witness(self._reached.store_id, number))
            except _CommitFailed as failed:
                self._find_out(number, failed.error)

    def _with_room(self, transaction: Callable[[int], None], number: int) -> None:
        try:
            transaction(number)
        except sqlite3.Error as error:
            if not is_full(error) or not self._can_write_log_anew():
                raise
            transaction(number)

    def _can_write_log_anew(self) -> bool:
        """Whether what the log has is in the file itself now, so that its room is free again."""
        try:
            busy, *_ = self._connection.execute("PRAGMA wal_checkpoint(RESTART)").fetchone()
        except sqlite3.Error:  # there is no room there either
            return False
        return not busy

    def _note(self, reached: Witness) -> None:
        self._reached = reached
        self._lock.note(reached)

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

    def _refuse_loss(self) -> None:
        """Refuse a file that lacks what this program has acknowledged."""
        known, reached = self._lock.witness or self._reached, self._reached
        if known.store_id == reached.store_id and known.commits > reached.commits:
            raise StoreError(loss(self._path, self._lock.path, known.commits - reached.commits))

    def _refuse_other_contents(self) -> None:
        """Refuse a database without tables if the lock has, or may have, counted transactions."""
        witness = self._lock.witness
        may_have_commits = self._lock.is_damaged or (witness is not None and witness.commits)
        if may_have_commits and not has_store(self._connection):
            text = path_checks.lost_store(self._path.resolve(), self._lock, "holds no store")
            raise StoreError(text)

    def _check(self) -> None:
        if self._why_broken:
            raise StoreError(self._why_broken)

    def _check_place(self) -> None:
        if not platform.is_same_file(self._path, self._file):
            raise StoreError(
                f"{self._path} was removed or replaced while it was in use; nothing was stored;"
                " put it back, or start the server again"
            )
        if self._lock.is_lost:
            raise StoreError(
                f"{self._path}: its lock {self._lock.path.name} was removed, so another server may"
                " use the file; nothing was stored; start this server again"
            )

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
            was_done = self._count().commits == number
            # Reading shows what the system remembers, be it on the disk or not. This writes it
            # anew, and writes over what would come to light again if the machine failed now.
            self._empty_log()
            self._in_transaction(lambda _: None, self._count().commits + 1)
            self._note(self._count())
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

    def _count(self) -> Witness:
        found = self._connection.execute("SELECT store_id, commits FROM taskrpc_store").fetchone()
        store_id, commits = found or (b"", 0)
        if not isinstance(store_id, bytes) or not isinstance(commits, int):
            return Witness(b"", 0)  # a reader of the tables will find it damaged
        return Witness(store_id, commits)


class MemoryDatabase:
    """A database without a file, used as `Database` is; it lasts until `close`, at most as long as
    the object itself.

    Args:
        prepare, equip: as for `Database`.

    Raises:
        Exception: `prepare` raised it.
    """

    is_broken = False

    def __init__(self, prepare: _Work, equip: _Work) -> None:
        # The loop that uses the store, and so the thread, may be another one later.
        self._connection = _connect(":memory:", check_same_thread=False)
        weakref.finalize(self, self._connection.close)  # Python 3.13 warns of one left open
        try:
            self.change(prepare)
        except BaseException:
            self.close()
            raise
        equip(self._connection)

    def read(self, work: Callable[[sqlite3.Connection], _Result]) -> _Result:
        """Look something up. Raises StoreError."""
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


def _connect(path: Path | str, *, check_same_thread: bool = True) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None, check_same_thread=check_same_thread)
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
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    # SQLite opens what it may only read, and would tell at the first change.
    if not os.access(path, os.R_OK | os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


def _make_private(path: Path) -> None:
    """Let nobody else read the file; SQLite gives those that it makes beside it the same rights."""
    # Not through a descriptor: closing one would drop the locks of other readers in this process.
    for suffix in path_checks.SIDE_FILES:
        with contextlib.suppress(FileNotFoundError):
            path.with_name(path.name + suffix).chmod(0o600)
