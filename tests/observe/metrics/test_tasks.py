"""The queue, the robot and the store as Prometheus sees them."""

import asyncio

import pytest

from taskrpc.observe.metrics import render
from taskrpc.observe.metrics.tasks import MeasuredStore, task_families
from taskrpc.robot.tasks.manager import TaskManager
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.robot.tasks.records.store import MemoryStore
from tests.observe.metrics.exposition import values
from tests.robot.tasks.fakes import FullStore, LineRobot


@pytest.fixture
async def manager():
    made = TaskManager(LineRobot(), MemoryStore())
    await made.start()
    yield made
    await made.close()


def states(manager, name="taskrpc_tasks"):
    told = values(render(task_families(manager)), name)
    return {state: count for state, count in told.items() if count}


async def test_queued_tasks_are_counted_by_priority(manager):
    await manager.pause()
    for priority in (1, 8, 8):
        await manager.submit("move", "3", priority)
    told = values(render(task_families(manager)), "taskrpc_queue_tasks")
    assert {priority: count for priority, count in told.items() if count} == {"1": 1, "8": 2}
    assert len(told) == 10


async def test_tasks_and_the_robot_are_counted_by_state(manager):
    assert states(manager) == {}
    assert states(manager, "taskrpc_robot_state") == {"idle": 1}
    await manager.submit("move", "3", 5)
    await manager.submit("move", "5", 5)
    await asyncio.sleep(1)
    assert states(manager) == {"QUEUED": 1, "RUNNING": 1}
    assert states(manager, "taskrpc_robot_state") == {"working": 1}
    await manager.pause()
    assert states(manager) == {"QUEUED": 1, "PAUSED": 1}
    assert states(manager, "taskrpc_robot_state") == {"paused": 1}
    await manager.resume()
    await asyncio.sleep(60)
    assert states(manager) == {"SUCCEEDED": 2}


async def test_a_store_is_measured_and_its_refusals_are_counted():
    inner = FullStore()
    inner.delay = 2.0
    store = MeasuredStore(inner)
    manager = TaskManager(LineRobot(), store)
    await manager.start()
    await manager.pause()
    await manager.submit("move", "3", 5)
    told = values(render(store.families()), "taskrpc_store_seconds")
    assert (told["_count"], told["_sum"]) == (1, 2.0)
    assert (told["_bucket/1"], told["_bucket/2.5"]) == (0, 1)
    assert values(render(store.families()), "taskrpc_store_tasks_total") == {"": 1}
    inner.is_full = True
    with pytest.raises(Exception, match="disk"):
        await manager.submit("move", "3", 5)
    inner.is_full = False
    assert values(render(store.families()), "taskrpc_store_failures_total") == {"": 1}
    assert values(render(store.families()), "taskrpc_store_seconds")["_count"] == 1
    await manager.close()


async def test_a_task_server_tells_how_many_changes_share_a_transaction(tmp_path):
    store = MeasuredStore(SqliteStore(tmp_path / "tasks.db"))
    manager = TaskManager(LineRobot(), store)
    await manager.start()
    await manager.pause()
    await asyncio.gather(*(manager.submit("move", "3", 5) for _ in range(20)))
    told = values(render(store.families()), "taskrpc_store_transaction_changes")
    assert told["_sum"] == 21
    assert told["_count"] < 10
    await manager.close()
