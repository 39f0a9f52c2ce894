"""The rules for every store: for all stores but PostgreSQL, which has its own test file."""

import msgspec
import pytest

from taskrpc.errors import StoreError
from taskrpc.robot.fleet.store import MemoryFleet, MemoryFleetStore
from taskrpc.robot.tasks.records.archive import SqliteEndedTasks, end_of
from taskrpc.robot.tasks.records.change_feed import ChangeFeed
from taskrpc.robot.tasks.records.history import History
from taskrpc.robot.tasks.records.repository import TaskRepository
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.robot.tasks.records.store import MemoryStore
from tests.robot.tasks.records.store_rules import HistoryRules, Opened, StoreRules, ended, make


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


class InMemory:
    """The ended tasks of a `MemoryFleet`, read as `EndedTasks`."""

    def __init__(self, database):
        self._database = database

    async def recent(self):
        return [task for _, task in self._database.tasks.values() if task.state.is_ended]

    async def archived(self, after):
        return sorted((task for task in self._database.archive if end_of(task) > after), key=end_of)


class TestHistoryInAFile(HistoryRules):
    @pytest.fixture
    async def opened(self, tmp_path):
        path, stores, sources = tmp_path / "tasks.db", [], []

        async def opened(history):
            for store in stores:
                await store.close()
            stores.append(store := SqliteStore(path, history=history))
            repository = TaskRepository(store, ChangeFeed())
            await repository.open()
            sources.append(source := SqliteEndedTasks(path))
            return Opened(store, repository.save, source)

        yield opened
        for each in (*sources, *stores):
            await each.close()


class TestHistoryOfAFleetInMemory(HistoryRules):
    @pytest.fixture
    async def opened(self):
        database = MemoryFleet(lambda: 1.0)

        async def opened(history):
            store = MemoryFleetStore(database, history=history)
            return Opened(store, lambda *tasks: store.apply(tasks), InMemory(database))

        return opened


async def test_a_store_in_memory_keeps_its_whole_history_in_memory():
    store = MemoryStore(history=History(count=5, recent=2))
    repository = TaskRepository(store, ChangeFeed())
    for number in range(1, 10):
        await repository.save(ended(number, number))
    assert [task.task_id for task in repository.ended()] == [9, 8, 7, 6, 5]


async def test_a_batch_that_fails_changes_nothing(tmp_path):
    store = SqliteStore(tmp_path / "tasks.db")
    await store.apply([make(1)])
    with pytest.raises((StoreError, msgspec.EncodeError, OverflowError)):
        await store.apply([make(2), make(2**80)], [1])
    assert [task.task_id for task in (await store.load()).tasks] == [1]
    await store.close()
