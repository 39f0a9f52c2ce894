"""Health reports success exactly while the server accepts tasks, and otherwise the reason."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc.errors import StoreError
from taskrpc.robot.tasks import TaskServer
from tests.robot.tasks.fakes import FullStore, LineRobot

Trigger = srvgen.load("std_srvs/srv/Trigger")


class Disk(FullStore):
    """A store on a disk that is slow to read, and may have room for little changes only."""

    def __init__(self):
        super().__init__()
        self.slowness = 0.0
        self.is_nearly_full = False

    async def load(self):
        await asyncio.sleep(self.slowness)
        return await super().load()

    async def apply(self, *what, **more):
        if self.is_nearly_full:
            raise StoreError("the disk is full")
        await super().apply(*what, **more)


@pytest.fixture
async def node():
    async with taskrpc.Node("task_server", transport="memory") as made:
        yield made


@pytest.fixture
def disk():
    return Disk()


@pytest.fixture
def server(node, disk):
    return TaskServer(node, LineRobot(), disk)


async def asked(node):
    client = node.create_client(Trigger, "/robot_task/health")
    answer = await client.call(Trigger.Request(), timeout=1)
    return answer.success, answer.message


async def test_estimate_queues_nothing(node, server):
    estimate_task = srvgen.load("taskrpc_interfaces/srv/EstimateTask")
    async with server:
        client = node.create_client(estimate_task, "/robot_task/estimate")
        request = estimate_task.Request(task_type="move", target="3", priority=5)
        for _ in range(2):
            answer = await client.call(request)
            assert (answer.success, answer.message) == (True, "Task would be queued: move")
            assert answer.estimated_time == pytest.approx(5.1)
        assert await asked(node) == (True, "ready: no tasks in the queue")


async def test_working_server_is_ready_and_describes_its_queue(node, server):
    async with server:
        assert await asked(node) == (True, "ready: no tasks in the queue")
        for target in ("3", "5", "7"):
            await server.manager.submit("move", target, 5)
        await asyncio.sleep(1)
        assert await asked(node) == (True, "ready: 2 tasks in the queue, task 1 is running")
        await server.manager.pause()
        told = "ready: 2 tasks in the queue, task 1 is running, the queue is paused"
        assert await asked(node) == (True, told)


async def test_health_counts_the_interrupted_tasks(node, disk):
    for name in ("first", "second"):  # each ends while it runs a task
        async with TaskServer(node, LineRobot(), disk, service_name=name) as server:
            await server.manager.submit("move", "3", 5)
            await asyncio.sleep(1)
            count = "" if name == "first" else ", 1 interrupted task waits for a decision"
            told = f"ready: no tasks in the queue, task {server.manager.running.task_id} is running"
            assert (await server.health()).message.partition(" (")[0] == told + count
    async with TaskServer(node, LineRobot(), disk) as server:
        told = "2 interrupted tasks wait for a decision (taskrpc task list --all)"
        assert await asked(node) == (True, f"ready: no tasks in the queue, {told}")
        for task_id in (1, 2):
            await server.manager.drop(task_id)
        assert await asked(node) == (True, "ready: no tasks in the queue")


async def test_a_server_that_reads_its_tasks_answers_that_it_is_not_ready(node, server, disk):
    disk.slowness = 60
    starting = asyncio.ensure_future(server.start())
    await asyncio.sleep(1)
    success, message = await asked(node)
    assert (success, message.partition(",")[0]) == (False, "not ready: starting")
    await starting
    assert (await asked(node))[0]
    await server.close()


async def test_a_server_that_ends_is_not_ready(node, server):
    await server.start()
    server.dismiss_watchers()
    assert await asked(node) == (False, "not ready: ending")
    await server.close()


async def test_a_store_that_refuses_makes_it_not_ready_until_it_takes_changes_again(
    node, server, disk
):
    async with server:
        disk.is_full = True
        with pytest.raises(StoreError):
            await server.manager.submit("move", "3", 5)
        for _ in range(2):
            assert await asked(node) == (False, "not ready: the disk is full")
        disk.is_full = False
        assert await asked(node) == (True, "ready: no tasks in the queue")


async def test_room_for_less_than_a_task_does_not_make_it_ready(node, server, disk):
    async with server:
        await server.manager.submit("move", "3", 5)
        await asyncio.sleep(100)
        before = await disk.load()
        disk.is_nearly_full = True
        with pytest.raises(StoreError):
            await server.manager.submit("move", "3", 5)
        for _ in range(2):
            assert await asked(node) == (False, "not ready: the disk is full")
        disk.is_nearly_full = False
        assert (await asked(node))[0]
        assert (await disk.load()).tasks == before.tasks


async def test_a_pause_that_could_not_be_stored_makes_it_not_ready(node, server, disk):
    async with server:
        disk.is_full = True
        await server.manager.pause()
        assert await asked(node) == (False, "not ready: the disk is full")


async def test_asking_a_store_again_changes_nothing_that_it_remembers(node, server, disk):
    async with server:
        await server.manager.pause()
        disk.is_full = True
        with pytest.raises(StoreError):
            await server.manager.resume()
        with pytest.raises(StoreError):
            await server.manager.submit("move", "3", 5)
        disk.is_full = False
        await asked(node)
        assert server.manager.is_paused
        assert (await disk.load()).paused


async def test_a_change_that_is_stored_makes_it_ready_too(server, disk):
    async with server:
        disk.is_full = True
        with pytest.raises(StoreError):
            await server.manager.submit("move", "3", 5)
        disk.is_full = False
        await server.manager.submit("move", "3", 5)
        disk.is_full = True
        assert (await server.health()).success
        disk.is_full = False
