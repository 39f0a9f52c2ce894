"""A database file that is removed, restored, damaged or made read-only, also while it is used."""

import contextlib
import errno
import os
import shutil
import sqlite3

import pytest

from taskrpc import SqliteCompletions
from taskrpc.core.request_ids.ids import Completion
from taskrpc.core.storage import database as database_module
from taskrpc.core.storage.database import Database
from taskrpc.core.system import file_locks, private_files
from taskrpc.errors import OutcomeUnknown, StoreError

on_windows = pytest.mark.skipif(os.name == "nt", reason="an open file cannot be moved there")


@pytest.fixture
def path(tmp_path):
    (tmp_path / "lab").mkdir()
    return tmp_path / "lab" / "tasks.db"


def make(path):
    return SqliteCompletions(path, ["CREATE TABLE IF NOT EXISTS seat (number INTEGER)"])


async def book(store, number):
    done = Completion("", number.to_bytes(16, "big"), 1, 1, b"f" * 16, b"", 0, 1.0)
    await store.complete(done, [("INSERT INTO seat VALUES (?)", (number,))])


async def killed(path, *numbers):
    """A folder as a program leaves it that was killed when it had stored these numbers."""
    store = make(path)
    for number in numbers:
        await book(store, number)
    shutil.copytree(path.parent, path.parent.with_name("left"))
    await store.close()
    shutil.rmtree(path.parent)
    path.parent.with_name("left").rename(path.parent)


async def booked(path):
    """What the next program finds; raises StoreError where it is refused."""
    store = make(path)
    try:
        remembered = await store.recall()
    finally:
        await store.close()
    return sorted(int.from_bytes(each.client, "big") for each in remembered.completions)


def log_of(path):
    return path.with_name("tasks.db-wal")


async def test_changes_of_a_killed_program_are_kept(path):
    await killed(path, 1, 2, 3)
    assert await booked(path) == [1, 2, 3]


@pytest.mark.parametrize("what", ["removed", "emptied", "cut", "damaged"])
async def test_log_without_acknowledged_transactions_is_refused(path, what):
    await killed(path, 1, 2, 3)
    log = log_of(path)
    data = bytearray(log.read_bytes())
    if what == "removed":
        log.unlink()
    elif what == "emptied":
        log.write_bytes(b"")
    elif what == "cut":
        log.write_bytes(data[:-4000])
    else:
        data[-100] ^= 1
        log.write_bytes(data)
    with pytest.raises(StoreError) as refused:
        await booked(path)
    lock = path.with_name("tasks.db.lock")
    count = "the last transaction" if what in ("cut", "damaged") else "the last 3 transactions"
    assert str(refused.value).startswith(
        f"{path} lacks {count} that it had: tasks.db-wal beside it was removed or damaged"
    )
    assert f"remove {lock} to go on" in str(refused.value)
    lock.unlink()
    assert await booked(path) == ([1, 2] if what in ("cut", "damaged") else [])


async def test_older_copy_of_the_file_is_refused(path, tmp_path):
    store = make(path)
    await book(store, 1)
    await store.close()
    shutil.copy(path, tmp_path / "copy")
    await book(store, 2)
    await store.close()
    shutil.copy(tmp_path / "copy", path)
    with pytest.raises(StoreError, match="lacks the last transaction that it had"):
        await booked(path)


async def test_file_that_another_program_has_read_is_complete(path):
    await killed(path, 1, 2)
    with contextlib.closing(sqlite3.connect(path)) as connection:  # it empties the log
        assert connection.execute("SELECT count(*) FROM seat").fetchone() == (2,)
    assert not log_of(path).exists()
    assert await booked(path) == [1, 2]


async def test_another_store_at_the_same_path_is_accepted(path, tmp_path):
    await killed(path, 1, 2)
    for each in (path, log_of(path)):
        each.unlink()
    other = make(tmp_path / "other.db")
    await book(other, 7)
    await other.close()
    (tmp_path / "other.db").rename(path)
    assert await booked(path) == [7]


@pytest.mark.parametrize("has_log", [True, False])
@pytest.mark.parametrize("what", ["missing", "empty"])
async def test_lost_database_is_refused_until_it_is_restored(path, what, has_log):
    await killed(path, 1, 2)
    lock, log, data = path.with_name("tasks.db.lock"), log_of(path), path.read_bytes()
    path.unlink()
    if what == "empty":
        path.touch()
    kept = log.read_bytes()
    if not has_log:
        log.unlink()
    beside = "tasks.db.lock and tasks.db-wal" if has_log else "tasks.db.lock"
    for _ in range(2):  # a refused start changes nothing
        with pytest.raises(StoreError) as refused:
            await booked(path)
        assert str(refused.value).startswith(
            f"{path} is {what}, but {beside} beside it belong{'' if has_log else 's'} to a"
            " database of 2 transactions; restore that database as tasks.db, or, to start"
            f" with an empty one, remove {lock}"
        )
    assert path.exists() == (what == "empty")
    path.write_bytes(data)
    log.write_bytes(kept)
    assert await booked(path) == [1, 2]


async def test_lost_database_is_replaced_after_its_lock_and_log_are_removed(path):
    await killed(path, 1, 2)
    path.unlink()
    path.with_name("tasks.db.lock").unlink()
    with pytest.raises(StoreError) as refused:
        await booked(path)
    log = log_of(path)
    assert str(refused.value) == (
        f"{path} is missing, but tasks.db-wal beside it belongs to a database; restore that"
        f" database as tasks.db, or, to start with an empty one, remove {log}"
    )
    log.unlink()
    assert await booked(path) == []


@pytest.mark.parametrize("what", ["missing", "empty"])
@pytest.mark.parametrize("contents", [b"garbage", b"\0" * 80 + b"store 0001"])
async def test_a_damaged_lock_without_a_database_is_refused(path, what, contents):
    lock = path.with_name("tasks.db.lock")
    lock.write_bytes(contents)
    if what == "empty":
        path.touch()
    for _ in range(2):  # a refused start changes nothing
        with pytest.raises(StoreError) as refused:
            await booked(path)
        assert str(refused.value) == (
            f"{path} is {what}, but tasks.db.lock (damaged) beside it may belong to a database;"
            f" restore that database as tasks.db, or, to start with an empty one, remove {lock}"
        )
    lock.unlink()
    assert await booked(path) == []


async def test_damaged_lock_beside_its_database_is_replaced(path):
    await killed(path, 1, 2)
    lock = path.with_name("tasks.db.lock")
    lock.write_bytes(b"garbage")
    assert await booked(path) == [1, 2]
    path.unlink()
    with pytest.raises(StoreError, match=r"tasks\.db\.lock beside it belongs to a database of"):
        await booked(path)


async def test_a_database_without_a_store_does_not_replace_a_lost_one(path):
    await killed(path, 1, 2)
    for each in (path, log_of(path)):
        each.unlink()
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE seat (number INTEGER)")
    with pytest.raises(
        StoreError, match=r"tasks\.db holds no store, but tasks\.db\.lock beside it"
    ):
        await booked(path)


async def test_store_without_transactions_may_be_removed(path):
    store = make(path)
    await store.recall()
    await store.close()
    path.unlink()
    assert await booked(path) == []


async def test_a_database_with_a_second_hard_link_is_refused(path, tmp_path):
    await killed(path, 1)
    other = tmp_path / "other.db"
    os.link(path, other)
    for name in (path, other):
        with pytest.raises(StoreError, match=r"has 2 names \(hard links\), so another server"):
            await booked(name)
    other.unlink()
    assert await booked(path) == [1]


@pytest.fixture
def open_folder(path):
    """The database's folder, where every user may write, as in /tmp."""
    path.parent.chmod(0o1777)
    return path.parent


@on_windows
@pytest.mark.parametrize("ending", ["", "-wal", "-shm", "-journal", ".lock"])
@pytest.mark.usefixtures("open_folder")
async def test_another_users_file_in_a_folder_open_to_all_is_refused(path, ending, monkeypatch):
    strange = path.with_name(path.name + ending)
    strange.touch(0o666)
    inode = strange.stat().st_ino
    monkeypatch.setattr(private_files, "is_ours_or_roots", lambda found: found.st_ino != inode)
    with pytest.raises(StoreError, match="belongs to another user, in a folder where every user"):
        await booked(path)
    strange.unlink()
    assert await booked(path) == []


@on_windows
@pytest.mark.parametrize("linked", ["file", "folder"])
async def test_a_symbolic_link_in_a_folder_open_to_all_is_not_followed(
    path, tmp_path, open_folder, linked
):
    target = tmp_path / "elsewhere"
    target.mkdir()
    link = open_folder / "link"
    link.symlink_to(target / "tasks.db" if linked == "file" else target)
    name = link if linked == "file" else link / "tasks.db"
    with pytest.raises(StoreError) as refused:
        await booked(name)
    assert str(link) in str(refused.value)
    assert "is a symbolic link in a folder where every user may write" in str(refused.value)
    assert list(target.iterdir()) == []
    open_folder.chmod(0o700)
    assert await booked(name) == []


async def test_lock_file_with_invalid_contents_is_replaced(path):
    await killed(path, 1)
    path.with_name("tasks.db.lock").write_bytes(b"\xff" * 300)
    assert await booked(path) == [1]


@on_windows
@pytest.mark.parametrize("what", ["file", "folder"])
async def test_removed_file_refuses_changes_until_it_is_restored(path, what):
    store = make(path)
    await book(store, 1)
    gone = path if what == "file" else path.parent
    gone.rename(gone.with_name("elsewhere"))
    with pytest.raises(StoreError, match="was removed or replaced while it was in use; nothing"):
        await book(store, 2)
    if what == "file":
        path.write_bytes(b"another file")
        with pytest.raises(StoreError, match="was removed or replaced"):
            await book(store, 2)
    gone.with_name("elsewhere").rename(gone)
    await book(store, 3)
    await store.close()
    assert await booked(path) == [1, 3]


def cut(path):
    os.truncate(path, 0)


def overwrite(path):
    """Write as much into the same file, as `cp` of an older copy does."""
    data = path.read_bytes()
    path.write_bytes(bytes(len(data)))
    os.utime(path, ns=(1, 1))  # a coarse clock may give the same time as the last change


def replace(path):
    path.with_name("copy").write_bytes(path.read_bytes())
    os.replace(path.with_name("copy"), path)


TAMPERING = [
    (cut, r" was changed by another program while it was in use \(expected \d+ bytes, found 0\)"),
    (overwrite, " was changed by another program while it was in use"),
    (replace, " was removed or replaced while it was in use"),
    (os.unlink, " was removed or replaced while it was in use"),
]


@on_windows
@pytest.mark.parametrize("ending", ["", "-wal"])
@pytest.mark.parametrize(("tamper", "problem"), TAMPERING)
async def test_file_that_another_program_changes_stores_nothing_more(path, ending, tamper, problem):
    store = make(path)
    await book(store, 1)
    tamper(path.with_name(path.name + ending))
    for number in (2, 3, 4):
        with pytest.raises(
            StoreError, match=rf"tasks\.db{ending}{problem}; nothing was stored; .*start the"
        ):
            await book(store, number)
    await store.close()
    with contextlib.suppress(StoreError):  # the next server says what is missing
        assert await booked(path) == [1]


@on_windows
@pytest.mark.parametrize(("tamper", "problem"), [TAMPERING[0], *TAMPERING[2:]])
async def test_change_in_a_file_that_is_tampered_with_meanwhile_is_not_acknowledged(
    path, database, tamper, problem
):
    def work(connection):
        connection.execute("INSERT INTO seat VALUES (1)")
        tamper(path)

    with pytest.raises(OutcomeUnknown, match=rf"{problem}, so a change may be lost; .*start the"):
        database.change(work)
    assert database.is_broken


@on_windows
async def test_store_whose_lock_was_removed_refuses_changes(path):
    first, second = make(path), make(path)
    await book(first, 1)
    path.with_name("tasks.db.lock").unlink()
    await book(second, 2)
    with pytest.raises(StoreError, match=r"its lock tasks\.db\.lock was removed, so another"):
        await book(first, 3)
    await first.close()
    await second.close()
    assert await booked(path) == [1, 2]


async def test_read_only_file_is_refused_when_it_is_opened(path, monkeypatch):
    await killed(path, 1)
    access = os.access  # root may write anything
    monkeypatch.setattr(os, "access", lambda at, mode: not mode & os.W_OK and access(at, mode))
    before = path.stat().st_mode
    with pytest.raises(StoreError, match=r"tasks\.db: the database cannot be opened: Perm"):
        await booked(path)
    assert path.stat().st_mode == before


async def test_a_lock_that_cannot_be_opened_is_named(path):
    path.with_name("tasks.db.lock").mkdir()
    with pytest.raises(StoreError, match=r"tasks\.db\.lock: "):
        await booked(path)


async def test_folder_without_file_locks_is_reported(path, monkeypatch):
    def no_locks(descriptor, *, wait):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(file_locks, "_lock", no_locks)
    with pytest.raises(StoreError) as refused:
        await booked(path)
    assert str(refused.value) == (
        f"{path}: its folder does not let files be locked (No locks available);"
        " keep it on a disk of this machine"
    )


@pytest.fixture
def database(path):
    def prepare(connection):
        connection.execute("CREATE TABLE IF NOT EXISTS taskrpc_store (store_id BLOB, commits INT)")
        connection.execute("CREATE TABLE IF NOT EXISTS seat (number INTEGER)")
        if connection.execute("SELECT 1 FROM taskrpc_store").fetchone() is None:
            connection.execute("INSERT INTO taskrpc_store VALUES (?, 0)", (b"S" * 16,))

    opened = Database(path, prepare, lambda connection: None, holder="test")
    yield opened
    opened.close()


def contents(database):
    def look(connection):
        (commits,) = connection.execute("SELECT commits FROM taskrpc_store").fetchone()
        return commits, [number for (number,) in connection.execute("SELECT number FROM seat")]

    return database.read(look)


def take_seat(number, *errors):
    """Work that fails with these errors first; counts how often it was tried."""
    tries = []

    def work(connection):
        tries.append(number)
        if len(tries) <= len(errors):
            raise errors[len(tries) - 1]
        connection.execute("INSERT INTO seat VALUES (?)", (number,))

    return work, tries


def sqlite_error(code):
    error = sqlite3.OperationalError("a text")
    error.sqlite_errorcode = code
    return error


def test_each_change_adds_one_to_the_count_of_commits(database):
    for number in (1, 2):
        database.change(take_seat(number)[0])
    assert contents(database) == (2, [1, 2])


def test_change_with_an_error_of_its_own_is_not_retried(database):
    work, tries = take_seat(1, sqlite_error(sqlite3.SQLITE_CONSTRAINT))
    with pytest.raises(sqlite3.Error):
        database.change(work)
    assert tries == [1]
    assert contents(database) == (0, [])


def test_change_on_a_full_disk_is_retried_after_the_log_is_emptied(database):
    database.change(take_seat(1)[0])
    work, tries = take_seat(2, sqlite_error(sqlite3.SQLITE_FULL))
    database.change(work)
    assert tries == [2, 2]
    assert contents(database) == (2, [1, 2])


def test_earlier_change_is_not_taken_for_one_whose_commit_failed(database, monkeypatch):
    def interrupted(transaction, number):
        transaction(number)
        raise KeyboardInterrupt

    execute, failures = database_module._execute, [sqlite_error(sqlite3.SQLITE_IOERR)]

    def fails_once(connection, ending, values=()):
        if failures:
            connection.execute("ROLLBACK")
            raise database_module._CommitFailed(failures.pop())
        execute(connection, ending, values)

    with monkeypatch.context() as patch:
        patch.setattr(database, "_with_room", interrupted)
        with pytest.raises(KeyboardInterrupt):
            database.change(take_seat(1)[0])
    monkeypatch.setattr(database_module, "_execute", fails_once)
    with pytest.raises(StoreError, match="nothing was stored"):
        database.change(take_seat(2)[0])
    assert contents(database)[1] == [1]


def test_statement_that_is_a_whole_transaction_counts_as_one_commit(database):
    database.change_at_once("UPDATE taskrpc_store SET store_id = ?, commits = ?", (b"S" * 16,))
    assert contents(database) == (1, [])
    database.change(take_seat(1)[0])
    assert contents(database) == (2, [1])


def test_lock_gets_the_new_id_of_a_cleared_store(database, path):
    def begin_anew(connection):
        connection.execute("UPDATE taskrpc_store SET store_id = ?", (b"T" * 16,))

    database.change(begin_anew)
    assert (b"T" * 16).hex().encode() in path.with_name("tasks.db.lock").read_bytes()


def test_change_is_on_the_disk_before_it_is_acknowledged(database):
    full = 2
    work = lambda connection: connection.execute("PRAGMA synchronous").fetchone()  # noqa: E731
    assert database.read(work) == (full,)
