import asyncio

import msgspec
import pytest

from taskrpc.errors import StoreError
from tests.robot.fleet.fakes import task

pytest.importorskip("psycopg")

from taskrpc.robot.fleet.postgres.connection import DatabaseUrl, close
from taskrpc.robot.fleet.postgres.schema import MIGRATIONS, VERSION, check_version, prepare
from taskrpc.robot.fleet.postgres.store import PostgresStore

pytestmark = [pytest.mark.postgres, pytest.mark.real_time]


@pytest.mark.parametrize("version", range(1, VERSION))
async def test_database_of_each_earlier_version_is_upgraded_and_keeps_its_tasks(
    postgres_url, version
):
    connection = await DatabaseUrl(postgres_url).connect("test")
    await prepare(connection, MIGRATIONS[:version])
    row = await (await connection.execute("SELECT version FROM taskrpc_fleet")).fetchone()
    assert row == (version,)
    record = msgspec.json.encode(task(1)).decode()
    await connection.execute("INSERT INTO taskrpc_task VALUES (1, 1, 'QUEUED', '', %s)", (record,))
    await connection.execute("UPDATE taskrpc_fleet SET revision = 1")
    await close(connection)
    store = PostgresStore(postgres_url)
    await store.apply([task(2)])
    assert (await store.load()).tasks == (task(1), task(2))
    await store.close()


async def test_server_of_an_older_version_changes_nothing_while_another_one_upgrades(
    postgres_url, monkeypatch
):
    old, new = PostgresStore(postgres_url), PostgresStore(postgres_url)
    with monkeypatch.context() as older:
        older.setattr(
            "taskrpc.robot.fleet.postgres.store.check_version",
            lambda found: check_version(found, VERSION - 1),
        )
        older.setattr(
            "taskrpc.robot.fleet.postgres.store.prepare",
            lambda connection: prepare(connection, MIGRATIONS[:-1]),
        )
        await old.apply([task(1)])
    await new.apply([task(2)])  # upgrades the tables while the older server is connected
    with monkeypatch.context() as older:
        older.setattr(
            "taskrpc.robot.fleet.postgres.store.check_version",
            lambda found: check_version(found, VERSION - 1),
        )
        for _ in range(2):
            with pytest.raises(StoreError, match="a newer taskrpc has upgraded it"):
                await old.apply([task(3)])
            assert "a newer taskrpc has upgraded it" in await old.follow(5)
    assert (await new.load()).tasks == (task(1), task(2))
    await old.close()
    await new.close()


async def test_servers_that_start_together_create_the_tables_once(postgres_url):
    stores = [PostgresStore(postgres_url) for _ in range(4)]
    found = await asyncio.gather(*(store.store_id() for store in stores))
    assert len(set(found)) == 1
    await asyncio.gather(*(store.close() for store in stores))


async def test_database_of_a_newer_version_is_refused(postgres_url):
    store = PostgresStore(postgres_url)
    await store.load()
    connection = await DatabaseUrl(postgres_url).connect("test")
    await connection.execute("UPDATE taskrpc_fleet SET version = version + 1")
    problem = f"expected a task database of version {VERSION}, found version {VERSION + 1}"
    with pytest.raises(StoreError, match=problem):  # a server that runs while it is upgraded
        await store.apply([task(1)])
    with pytest.raises(StoreError, match="a newer taskrpc has upgraded it"):
        await PostgresStore(postgres_url).load()
    await close(connection)
    await store.close()


def test_version_is_that_of_the_last_migration():
    check_version(VERSION)
    with pytest.raises(StoreError):
        check_version(VERSION + 1)


@pytest.mark.parametrize(
    "statement",
    ["DROP TABLE taskrpc_completion", "ALTER TABLE taskrpc_task RENAME COLUMN robot TO rover"],
)
async def test_tables_that_lack_a_column_are_refused_at_the_start(postgres_url, statement):
    connection = await DatabaseUrl(postgres_url).connect("test")
    await prepare(connection)
    await connection.execute(statement)
    store = PostgresStore(postgres_url)
    with pytest.raises(StoreError, match=r"but .* does not exist; restore a backup"):
        await store.refresh()
    await close(connection)
    await store.close()
