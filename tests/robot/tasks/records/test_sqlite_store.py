"""The SQLite file: one server at a time, refused files, and errors for users."""

import asyncio
import os
import re
import sqlite3

import pytest

from taskrpc.errors import StoreError
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore


def make(number):
    return Task(
        task_id=number,
        task_type="move",
        target="dock",
        priority=5,
        arrival=number,
        submitted_at=0.0,
    )


@pytest.fixture
def path(tmp_path):
    return tmp_path / "tasks.db"


async def refused(path):
    """The sentence with which the file is refused."""
    store = SqliteStore(path)
    with pytest.raises(StoreError) as error:
        await store.load()
    await store.close()
    assert "\n" not in str(error.value)
    return str(error.value)


async def test_next_server_finds_tasks_saved_before_a_kill(path, tmp_path):
    store = SqliteStore(path)
    await store.apply([make(1), make(2)])
    survivors = tmp_path / "after"  # what a killed process leaves: the files as they are now
    survivors.mkdir()
    for name in ("tasks.db", "tasks.db-wal"):
        (survivors / name).write_bytes((tmp_path / name).read_bytes())
    await store.close()
    successor = SqliteStore(survivors / "tasks.db")
    assert [task.task_id for task in (await successor.load()).tasks] == [1, 2]
    await successor.close()


async def test_second_server_gets_an_error_that_names_the_first(path):
    store = SqliteStore(path)
    await store.load()
    message = await refused(path)
    assert f"{path} is in use by another task server (pid {os.getpid()}, since 2" in message
    await store.close()


async def test_the_file_is_free_after_close_and_after_a_refusal(path):
    store = SqliteStore(path)
    await store.load()
    await refused(path)
    await store.close()
    second = SqliteStore(path)
    await second.load()
    await second.close()


async def test_one_file_by_two_names_is_still_one_file(path, tmp_path, symlink):
    alias = tmp_path / "alias.db"
    symlink(alias, path)
    store = SqliteStore(path)
    await store.load()
    assert "is in use by another task server" in await refused(alias)
    await store.close()


async def test_a_text_file_is_refused_and_left_as_it_is(path):
    path.write_text("my shopping list, which is longer than a database's header is" * 20)
    before = path.read_bytes()
    assert await refused(path) == f"{path}: expected a database, found another file"
    assert path.read_bytes() == before


async def test_another_programs_database_is_refused_and_left_as_it_is(path):
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE bookmarks (url TEXT)")
    connection.close()
    before = path.read_bytes()
    assert "found another program's database" in await refused(path)
    assert path.read_bytes() == before


@pytest.mark.skipif(os.name == "nt", reason="rights are another matter there")
async def test_other_users_cannot_read_the_files(path, tmp_path):
    path.touch(0o644)
    store = SqliteStore(path)
    await store.apply([make(1)])
    modes = {entry.name: oct(entry.stat().st_mode & 0o777) for entry in tmp_path.iterdir()}
    await store.close()
    names = ["tasks.db", "tasks.db-wal", "tasks.db-shm", "tasks.db.lock"]
    assert modes == dict.fromkeys(names, "0o600")


async def test_fresh_start_accepts_a_lost_database(path):
    store = SqliteStore(path)
    await store.apply([make(1)])
    await store.close()
    path.unlink()
    assert await refused(path)
    store = SqliteStore(path)
    await store.clear()
    await store.apply([make(1)])
    await store.close()
    store = SqliteStore(path)
    assert [task.task_id for task in (await store.load()).tasks] == [1]
    await store.close()
    path.unlink()
    assert "is missing, but tasks.db.lock beside it belongs to a database" in await refused(path)


async def test_error_names_a_missing_folder(tmp_path):
    missing = tmp_path / "no" / "tasks.db"
    assert await refused(missing) == f"{missing}: there is no folder {missing.parent}"


async def test_a_folder_in_place_of_the_file_is_refused(path):
    path.mkdir()
    assert await refused(path) == f"{path}: expected a database, found a folder"


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
async def test_error_names_an_unwritable_folder(tmp_path):
    tmp_path.chmod(0o500)
    try:
        assert "Permission denied" in await refused(tmp_path / "tasks.db")
    finally:
        tmp_path.chmod(0o700)


async def test_every_commit_is_synced_to_the_disk(path):
    store = SqliteStore(path)
    await store.load()

    def sync_settings(connection):
        names = ("synchronous", "journal_mode")
        return [connection.execute(f"PRAGMA {name}").fetchone()[0] for name in names]

    assert await store._writer.read(sync_settings) == [2, b"wal"]
    await store.close()


async def test_calls_made_at_once_are_all_kept(path):
    store = SqliteStore(path)
    await asyncio.gather(*(store.apply([make(number)]) for number in range(1, 51)))
    assert len((await store.load()).tasks) == 50
    await store.close()


async def test_a_closed_store_leaves_one_database_file_and_its_lock(path, tmp_path):
    store = SqliteStore(path)
    await store.apply([make(1)])
    await store.close()
    assert sorted(entry.name for entry in tmp_path.glob("tasks*")) == ["tasks.db", "tasks.db.lock"]


async def test_claim_waits_for_the_other_server_and_reports_it_once(tmp_path):
    first, second = SqliteStore(tmp_path / "tasks.db"), SqliteStore(tmp_path / "tasks.db")
    await first.claim()
    told = []
    claim = asyncio.ensure_future(second.claim(lambda error: told.append(error.fact)))
    await asyncio.sleep(3)
    assert not claim.done()
    (fact,) = told
    assert re.search(r"tasks\.db is in use by another task server \(pid \d+, since .*\)$", fact)
    await first.close()
    await claim
    with pytest.raises(StoreError, match=r"is in use .*; stop that one, or give this one"):
        await first.load()
    await second.close()


async def test_a_file_that_cannot_be_used_ends_a_claim(tmp_path):
    (tmp_path / "tasks.db").write_text("no database" * 100)
    store = SqliteStore(tmp_path / "tasks.db")
    with pytest.raises(StoreError, match="expected a database"):
        await store.claim()
    await store.close()
