"""The tables of tasks: damage is named, and other formats are refused."""

import asyncio
import random
import re
import sqlite3

import pytest

from taskrpc.core.request_ids.ids import Completion
from taskrpc.errors import StoreError
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.robot.tasks.records.task_tables import FORMAT
from tests.robot.tasks.records.test_sqlite_store import make, refused


def completion(sequence, first=1):
    return Completion("ann", b"c" * 16, sequence, first, b"f" * 16, b"answer", 0, 1.5)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "tasks.db"


@pytest.mark.parametrize("version", [FORMAT - 2, FORMAT + 1])
async def test_a_file_of_another_format_is_refused(path, version):
    store = SqliteStore(path)
    await store.load()
    await store.close()
    with sqlite3.connect(path) as connection:
        connection.execute(f"PRAGMA user_version = {version}")
    connection.close()
    message = await refused(path)
    assert f"expected a task database of format {FORMAT}, found format {version}" in message


async def test_file_of_the_format_before_the_history_is_upgraded_and_keeps_its_tasks(path):
    store = SqliteStore(path)
    await store.apply([make(1), make(7)])
    await store.close()
    with sqlite3.connect(path) as connection:
        connection.execute("DROP TABLE history")
        connection.execute("PRAGMA user_version = 2")
    connection.close()
    store = SqliteStore(path)
    await store.apply([make(8)])
    assert (await store.load()).tasks == (make(1), make(7), make(8))
    await store.close()
    with sqlite3.connect(path) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (FORMAT,)
    connection.close()


SEVEN = "(table task, row task_id = 7: "
DAMAGES = {
    "another record": ("UPDATE task SET record = '{}' WHERE task_id = 7", SEVEN),
    "bytes": ("UPDATE task SET record = x'ff00' WHERE task_id = 7", SEVEN),
    "a number": ("UPDATE task SET record = 5 WHERE task_id = 7", SEVEN),
    "another checksum": ("UPDATE task SET checksum = 0 WHERE task_id = 7", SEVEN),
    "another number": ("UPDATE task SET task_id = 8 WHERE task_id = 7", "row task_id = 8: "),
    "no server": ("DELETE FROM server", "(table server: expected one row"),
    "no sense": ("UPDATE server SET next_id = 'seven'", "(table server: expected one row"),
    "no table": ("DROP TABLE task", "the table task is not the one that taskrpc writes: expected"),
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
