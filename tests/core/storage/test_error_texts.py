"""What goes wrong with a file becomes one sentence that names the file and says what to do."""

import errno
import os
import sqlite3

import pytest

from taskrpc.core.storage.error_texts import is_about_the_file, is_full, loss_text, store_errors
from taskrpc.core.storage.records import Damaged
from taskrpc.errors import StoreError
from tests.core.storage.conftest import sqlite_error


@pytest.fixture
def path(tmp_path):
    return tmp_path / "tasks.db"


def said(path, error, **options):
    with pytest.raises(StoreError) as caught, store_errors(path, **options):
        raise error
    place = path.resolve()
    assert caught.value.files == (str(path), str(place), str(place.parent))
    return str(caught.value).replace(str(path), "PATH")


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (sqlite3.SQLITE_NOTADB, "PATH: expected a database, found another file"),
        (sqlite3.SQLITE_FULL, "PATH: the disk is full; nothing was stored"),
        (
            sqlite3.SQLITE_CORRUPT,
            "PATH is damaged (why); restore the file from a copy, or move PATH* away to start with"
            " an empty database",
        ),
        (sqlite3.SQLITE_IOERR | 2 << 8, "PATH: the database cannot be used: why"),
    ],
)
def test_errors_of_sqlite_have_different_messages(path, code, text):
    error = sqlite_error(code, "why")
    assert is_about_the_file(error)
    assert is_full(error) is (code == sqlite3.SQLITE_FULL)
    assert said(path, error, except_statements=True) == text


def test_error_of_a_statement_is_not_translated(path):
    for error in (sqlite_error(sqlite3.SQLITE_CONSTRAINT), sqlite3.OperationalError("no code")):
        assert not is_about_the_file(error)
        with pytest.raises(sqlite3.OperationalError), store_errors(path, except_statements=True):
            raise error
    assert said(path, sqlite3.OperationalError("why")) == "PATH: the database cannot be used: why"


def test_errors_of_the_system_have_different_messages(path):
    def of(number, filename=None):
        return OSError(number, os.strerror(number), filename)

    missing = path.parent / "nowhere" / "tasks.db"
    folder = missing.parent
    text = f"{missing}: there is no folder {folder}"
    assert said(missing, of(errno.ENOENT)).replace("PATH", str(missing)) == text
    other = f"{missing}: the database cannot be opened: Permission denied"
    assert said(missing, of(errno.EACCES)).replace("PATH", str(missing)) == other
    assert said(path, of(errno.ENOENT)) == (
        "PATH: the database cannot be opened: No such file or directory"
    )
    assert said(path, of(errno.EACCES, "x.lock")) == (
        "PATH: the database cannot be opened: x.lock: Permission denied"
    )
    path.mkdir()
    assert said(path, of(errno.EISDIR)) == "PATH: expected a database, found a folder"


def test_damaged_row_is_shown_with_the_statement_that_deletes_it(path):
    damaged = Damaged("task", "the checksum does not match", "task_id = 7")
    assert said(path, damaged) == (
        "PATH is damaged (table task, row task_id = 7: the checksum does not match);"
        " restore the file from a copy,"
        ' or delete the row: sqlite3 PATH "DELETE FROM task WHERE task_id = 7"'
    )
    assert said(path, Damaged("taskrpc_store", "it has no row")) == (
        "PATH is damaged (table taskrpc_store: it has no row);"
        " restore the file from a copy, or move PATH* away to start with an empty database"
    )


@pytest.mark.parametrize(
    ("missing", "text"), [(1, "the last transaction that"), (3, "the last 3 transactions that")]
)
def test_missing_transactions_are_counted(path, missing, text):
    assert text in loss_text(path, path.with_name("tasks.db.lock"), missing)
