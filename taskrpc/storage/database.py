"""One SQLite file in the hands of one process: its lock, its tables, its transactions."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path

from taskrpc import platform
from taskrpc.errors import StoreError

_SIDE_FILES = ("", "-wal", "-shm")


class Database:
    """The open file; every call from one thread.

    Args:
        path: the database file; made if it is not there. A file `<path>.lock` beside it says
            which process uses it.
        prepare: makes the tables that a file lacks, in a transaction, or refuses the file.
        holder: what uses such a file, as a sentence names it.
    """

    def __init__(
        self, path: Path, prepare: Callable[[sqlite3.Connection], None], *, holder: str
    ) -> None:
        with contextlib.ExitStack() as undo:
            undo.enter_context(_held(path, holder))
            _create_private(path.resolve())
            self.connection = sqlite3.connect(path, isolation_level=None)
            undo.callback(self.connection.close)
            # What a damaged file holds need not be text.
            self.connection.text_factory = bytes
            self.connection.execute("PRAGMA synchronous = FULL")
            with self.transaction():
                prepare(self.connection)
            _make_private(path.resolve())
            self.connection.execute("PRAGMA journal_mode = WAL")
            self._undo = undo.pop_all()

    @contextlib.contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Everything in the block or nothing of it; on the disk when it ends."""
        self.connection.execute("BEGIN IMMEDIATE")
        try:
            yield self.connection
            self.connection.execute("COMMIT")
        except BaseException:
            if self.connection.in_transaction:
                self.connection.execute("ROLLBACK")
            raise

    def close(self) -> None:
        """Write everything into the one file and let others use it."""
        self._undo.close()


def pragma(connection: sqlite3.Connection, name: str) -> int:
    """A number that SQLite keeps in the file's head."""
    value: int = connection.execute(f"PRAGMA {name}").fetchone()[0]
    return value


def has_table(connection: sqlite3.Connection, name: str) -> bool:
    """Whether there is a table of this name."""
    found = connection.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (name,))
    return found.fetchone() is not None


def _create_private(path: Path) -> None:
    with contextlib.suppress(FileExistsError):
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600))


def _make_private(path: Path) -> None:
    """Let nobody else read the file; SQLite gives those that it makes beside it the same rights."""
    # Not through a descriptor: closing one would drop the locks of other readers in this process.
    for suffix in _SIDE_FILES:
        with contextlib.suppress(FileNotFoundError):
            path.with_name(path.name + suffix).chmod(0o600)


@contextlib.contextmanager
def _held(path: Path, holder: str) -> Iterator[None]:
    """Hold the lock beside the file, or say who does."""
    lock_path = path.resolve().with_name(path.resolve().name + ".lock")
    descriptor = platform.open_private(lock_path)
    try:
        if not platform.try_lock(descriptor):
            found = os.read(descriptor, 200).decode(errors="replace").strip()
            raise StoreError(
                f"{path} is in use by another {holder} ({found}); "
                "stop that one, or give this one another file"
            )
        lock_path.chmod(0o600)
        os.ftruncate(descriptor, 0)
        since = datetime.now().astimezone().isoformat(" ", "seconds")
        os.write(descriptor, f"pid {os.getpid()}, since {since}\n".encode())
        yield
    finally:
        os.close(descriptor)
