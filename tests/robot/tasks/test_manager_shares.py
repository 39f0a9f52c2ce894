"""No account fills the queue: each has a share, and the order of execution stays the same."""

import pytest

from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.records.store import MemoryStore
from tests.robot.tasks.fakes import LineRobot


@pytest.fixture
async def manager():
    manager = TaskManager(LineRobot(), MemoryStore(), TaskSettings(queue_limit=20, share=3))
    await manager.start()
    await manager.pause()
    yield manager
    await manager.close()


async def submit(manager, account, priority=5):
    client = account or "/node"
    return await manager.submit("move", "3", priority, client=client, account=account)


async def test_a_full_share_is_refused_with_how_many_wait(manager):
    for _ in range(3):
        assert (await submit(manager, "ada")).success
    refused = await submit(manager, "ada")
    assert not refused.success
    assert refused.message == "Share full: ada (waiting: 3, limit for one account: 3)"
    assert refused.task_id == -1


async def test_others_and_the_lecturer_are_not_kept_out(manager):
    for _ in range(3):
        await submit(manager, "ada")
    assert (await submit(manager, "ad")).success
    for _ in range(5):
        assert (await submit(manager, "")).success


async def test_a_task_that_leaves_the_queue_frees_its_place(manager):
    answers = [await submit(manager, "ada") for _ in range(3)]
    await manager.cancel(answers[1].task_id)
    assert (await submit(manager, "ada")).success
    assert not (await submit(manager, "ada")).success


async def test_only_priority_and_arrival_decide_the_next_task(manager):
    low = await submit(manager, "ada", 1)
    first = await submit(manager, "bob", 5)
    second = await submit(manager, "ada", 5)
    order = [task.task_id for task, _ in manager.queue.ordered()]
    assert order == [first.task_id, second.task_id, low.task_id]


async def test_the_tasks_of_the_server_before_count(manager):
    store = MemoryStore()
    for expected in (True, False):
        server = TaskManager(LineRobot(), store, TaskSettings(share=1))
        await server.start()
        await server.pause()
        assert (await submit(server, "ada")).success is expected
        await server.close()


async def test_machines_of_one_account_have_a_share_each(manager):
    for machine in ("192.0.2.1", "192.0.2.2"):
        for expected in (True, True, True, False):
            answer = await manager.submit(
                "move", "3", 5, client="class", account="class", machine=machine
            )
            assert answer.success is expected
    whose = "class at 192.0.2.2"
    assert answer.message == f"Share full: {whose} (waiting: 3, limit for one account: 3)"
