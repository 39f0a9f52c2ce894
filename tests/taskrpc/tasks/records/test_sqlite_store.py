"""The SQLite file: one server at a time, refused files, and errors for users."""

import asyncio
import os
import random
import re
import sqlite3

import msgspec
import pytest

from taskrpc.errors import StoreError
from taskrpc.request_ids.ids import Completion
from taskrpc.tasks.model import Task
from taskrpc.tasks.records.sqlite_store import SqliteStore
from taskrpc.tasks.records.task_tables import FORMAT


def make(number):
    return Task(
        task_id=number,
        task_type="move",
        target="dock",
        priority=5,
        arrival=number,
        submitted_at=0.0,
    )


def completion(sequence, first=1):
    return Completion("ann", b"c" * 16, sequence, first, b"f" * 16, b"answer", 0, 1.5)


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
    assert await refused(path) == f"{path}: expected a database, found another file"
    assert path.read_bytes() == before


async def test_another_programs_database_is_refused_and_left_as_it_is(path):
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE bookmarks (url TEXT)")
    connection.close()
    before = path.read_bytes()
    assert "found another program's database" in await refused(path)
    assert path.read_bytes() == before


SEVEN = "(table task, row task_id = 7: "
DAMAGES = {
    "another record": ("UPDATE task SET record = '{}' WHERE task_id = 7", SEVEN),
    "bytes": ("UPDATE task SET record = x'ff00' WHERE task_id = 7", SEVEN),
    "a number": ("UPDATE task SET record = 5 WHERE task_id = 7", SEVEN),
    "another checksum": ("UPDATE task SET checksum = 0 WHERE task_id = 7", SEVEN),
    "another number": ("UPDATE task SET task_id = 8 WHERE task_id = 7", "row task_id = 8: "),
    "no server": ("DELETE FROM server", "(table server: expected one row"),
    "no sense": ("UPDATE server SET next_id = 'seven'", "(table server: expected one row"),
    "no table": ("DROP TABLE task", "no such table: task"),
    "no id": ("UPDATE taskrpc_store SET store_id = 'short'", "expected the store's id of 16 bytes"),
    "no store": ("DELETE FROM taskrpc_store", "expected the store's id of 16 bytes"),
    "a completion": (
        "UPDATE taskrpc_completion SET record = 'x'",
        f"row client = '{'63' * 16}' AND sequence = '{3:016x}': the checksum does not match",
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
async def test_damage_error_names_file_table_and_task(path, damage):
    statement, said = DAMAGES[damage]
    store = SqliteStore(path)
    await store.apply([make(1), make(7)], completion=completion(3))
    await store.close()
    with sqlite3.connect(path) as connection:
        connection.execute(statement)
    connection.close()
    message = await refused(path)
    assert message.startswith(str(path))
    assert said in message


DAMAGE = {
    "a byte": lambda data, chance: _overwritten(data, chance.randrange(len(data)), b"\xa5"),
    "a sector": lambda data, chance: _overwritten(
        data, chance.randrange(len(data) // 512) * 512, chance.randbytes(512)
    ),
    "an empty page": lambda data, chance: _overwritten(
        data, chance.randrange(len(data) // 4096) * 4096, bytes(4096)
    ),
    "a missing end": lambda data, chance: data[: chance.randrange(len(data))],
    "another page": lambda data, chance: _overwritten(
        data, _page(data, chance), data[(at := _page(data, chance)) : at + 4096]
    ),
}


def _page(data, chance):
    return chance.randrange(len(data) // 4096) * 4096


def _overwritten(data, at, new):
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize("damage", DAMAGE)
async def test_file_damaged_anywhere_gives_one_sentence_or_loads_completely(path, damage):
    store = SqliteStore(path)
    calls = (store.apply([make(each)], completion=completion(each)) for each in range(1, 200))
    await asyncio.gather(*calls)
    whole = await store.load()
    await store.close()
    data, chance, told = path.read_bytes(), random.Random(7), []
    for _ in range(40):
        path.write_bytes(DAMAGE[damage](data, chance))
        store = SqliteStore(path)
        try:
            assert await store.load() == whole
        except StoreError as error:
            told.append(str(error))
        await store.close()
    assert len(told) > 10
    assert all(text.startswith(str(path)) and text.isprintable() for text in told)


async def test_the_rest_is_there_once_a_damaged_task_was_given_up_as_the_sentence_says(path):
    store = SqliteStore(path)
    await store.apply([make(1), make(7), make(9)])
    await store.close()
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE task SET record = '{}' WHERE task_id = 7")
    connection.close()
    advised = re.search(r'sqlite3 (\S+) "(.*)"', await refused(path))
    with sqlite3.connect(advised[1]) as connection:
        connection.execute(advised[2])
    connection.close()
    store = SqliteStore(path)
    assert [task.task_id for task in (await store.load()).tasks] == [1, 9]
    await store.close()


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


FORMAT_1 = """
    CREATE TABLE task (task_id INTEGER PRIMARY KEY, record TEXT NOT NULL);
    CREATE TABLE server (next_id INTEGER NOT NULL, paused INTEGER NOT NULL);
    INSERT INTO server VALUES (8, 1);
    PRAGMA application_id = 0x54525043;
    PRAGMA user_version = 1;
"""


def written_by_the_first_version(path, records):
    with sqlite3.connect(path) as connection:
        connection.executescript(FORMAT_1)
        rows = [(number, record) for number, record in records.items()]
        connection.executemany("INSERT INTO task VALUES (?, ?)", rows)
    connection.close()


async def test_a_file_of_the_first_format_is_brought_up_to_date(path):
    tasks = [make(1), make(7)]
    records = {task.task_id: msgspec.json.encode(task).decode() for task in tasks}
    written_by_the_first_version(path, records)
    for _ in range(2):
        store = SqliteStore(path)
        stored = await store.load()
        assert (list(stored.tasks), stored.next_id, stored.paused) == (tasks, 8, True)
        assert (len(stored.store_id), stored.completions) == (16, ())
        await store.close()


async def test_a_file_of_the_first_format_that_is_damaged_stays_as_it_was(path):
    written_by_the_first_version(path, {1: '{"task_id": "one"}'})
    before = path.read_bytes()
    assert "(table task, row task_id = 1: Expected `int`, got `str`" in await refused(path)
    assert path.read_bytes() == before


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
