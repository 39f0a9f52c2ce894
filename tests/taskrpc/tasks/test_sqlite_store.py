"""The file: who may use it, what is refused, and what a user is told."""

import asyncio
import os
import sqlite3

import pytest

from taskrpc.tasks.model import Task
from taskrpc.tasks.sqlite_store import FORMAT, SqliteStore
from taskrpc.tasks.store import StoreError


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


async def test_another_server_finds_what_was_saved_before_a_kill(path, tmp_path):
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


async def test_a_second_server_on_the_file_is_told_who_has_it(path):
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


async def test_one_file_by_two_names_is_still_one_file(path, tmp_path):
    alias = tmp_path / "alias.db"
    store = SqliteStore(path)
    await store.load()
    try:
        alias.symlink_to(path)
    except OSError:
        await store.close()
        pytest.skip("this system lets only administrators make links")
    assert "is in use by another task server" in await refused(alias)
    await store.close()


async def test_a_file_of_a_newer_version_is_refused(path):
    store = SqliteStore(path)
    await store.load()
    await store.close()
    with sqlite3.connect(path) as connection:
        connection.execute(f"PRAGMA user_version = {FORMAT + 1}")
    connection.close()
    message = await refused(path)
    assert f"expected a task database of format {FORMAT}, found format {FORMAT + 1}" in message


async def test_a_text_file_is_refused_and_left_as_it_is(path):
    path.write_text("my shopping list, which is longer than a database's header is" * 20)
    before = path.read_bytes()
    assert await refused(path) == f"{path}: expected a task database, found another file"
    assert path.read_bytes() == before


async def test_another_programs_database_is_refused_and_left_as_it_is(path):
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE bookmarks (url TEXT)")
    connection.close()
    before = path.read_bytes()
    assert "found another program's database" in await refused(path)
    assert path.read_bytes() == before


async def test_a_damaged_record_is_named_as_such(path):
    store = SqliteStore(path)
    await store.apply([make(1)])
    await store.close()
    with sqlite3.connect(path) as connection:
        connection.execute('UPDATE task SET record = \'{"task_id": "one"}\'')
    connection.close()
    assert "holds a damaged task" in await refused(path)


async def test_a_folder_that_is_not_there_is_named(tmp_path):
    missing = tmp_path / "no" / "tasks.db"
    message = await refused(missing)
    assert message == f"{missing}: the task database cannot be opened: No such file or directory"


async def test_a_folder_in_place_of_the_file_is_refused(path):
    path.mkdir()
    assert str(path) in await refused(path)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
async def test_a_folder_without_the_right_to_write_is_named(tmp_path):
    tmp_path.chmod(0o500)
    try:
        assert "Permission denied" in await refused(tmp_path / "tasks.db")
    finally:
        tmp_path.chmod(0o700)


async def test_every_commit_is_synced_to_the_disk(path):
    store = SqliteStore(path)
    await store.load()

    def sync_settings(file):
        return [file._pragma("synchronous"), file._pragma("journal_mode")]

    assert await store._do(sync_settings) == [2, "wal"]
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
