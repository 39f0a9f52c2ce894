"""A disk that fails on request: it replaces `sqlite3.connect` below a `Database`."""

import sqlite3

import pytest

from taskrpc.core.storage import database


def sqlite_error(code, text="disk I/O error"):
    error = sqlite3.OperationalError(text)
    error.sqlite_errorcode = code
    return error


class Disk:
    """What the next COMMITs do.

    Attributes:
        failures: for each coming COMMIT, in order: None to let it be, "before" to fail instead of
            it, "after" to fail although it was done, or an SQLite error code to fail with.
        is_gone: whether the file cannot be opened.
        commits: how many were tried.
    """

    def __init__(self):
        self.failures = []
        self.is_gone = False
        self.commits = 0

    def connect(self, path):
        if self.is_gone:
            raise sqlite_error(sqlite3.SQLITE_CANTOPEN, "unable to open database file")
        disk = self

        class Connection(sqlite3.Connection):
            def execute(self, sql, *parameters):
                return (
                    disk.commit(super()) if sql == "COMMIT" else super().execute(sql, *parameters)
                )

        connection = sqlite3.connect(path, isolation_level=None, factory=Connection)
        connection.text_factory = bytes
        connection.execute("PRAGMA synchronous = FULL")
        return connection

    def commit(self, connection):
        self.commits += 1
        failure = self.failures.pop(0) if self.failures else None
        if isinstance(failure, int):
            raise sqlite_error(failure, "no")
        if failure == "before":
            raise sqlite_error(sqlite3.SQLITE_IOERR)
        done = connection.execute("COMMIT")
        if failure == "after":
            raise sqlite_error(sqlite3.SQLITE_IOERR)
        return done


@pytest.fixture
def disk(monkeypatch):
    made = Disk()
    monkeypatch.setattr(database, "_connect", made.connect)
    return made
