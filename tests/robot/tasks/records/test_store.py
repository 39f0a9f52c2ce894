"""The rules for every store: for all stores but PostgreSQL, which has its own test file."""

import msgspec
import pytest

from taskrpc.errors import StoreError
from taskrpc.robot.fleet.store import MemoryFleet, MemoryFleetStore
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.robot.tasks.records.store import MemoryStore
from tests.robot.tasks.records.store_rules import StoreRules, make


class TestStore(StoreRules):
    @pytest.fixture(params=["memory", "sqlite", "fleet in memory"])
    async def store(self, request, tmp_path):
        if request.param == "memory":
            store = MemoryStore()
        elif request.param == "sqlite":
            store = SqliteStore(tmp_path / "tasks.db")
        else:
            store = MemoryFleetStore(MemoryFleet(lambda: 1.0))
        yield store
        await store.close()


async def test_a_batch_that_fails_changes_nothing(tmp_path):
    store = SqliteStore(tmp_path / "tasks.db")
    await store.apply([make(1)])
    with pytest.raises((StoreError, msgspec.EncodeError, OverflowError)):
        await store.apply([make(2), make(2**80)], [1])
    assert [task.task_id for task in (await store.load()).tasks] == [1]
    await store.close()
