"""The services: their names and types, requests and responses."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks import MemoryStore, Resumed, SqliteStore, TaskServer
from tests.robot.tasks.fakes import FullStore, LineRobot

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")


class Client:
    """Calls the task server's services by verb."""

    def __init__(self, node):
        self._node = node
        self._clients = {}

    async def submit(self, task_type, target, priority, **options):
        client = self._clients.setdefault(
            "submit", self._node.create_client(RobotTask, "/robot_task", timeout=100)
        )
        return await client.call(
            RobotTask.Request(task_type=task_type, target=target, priority=priority), **options
        )

    async def __call__(self, type_name, **fields):
        verb = type_name.removesuffix("Tasks").removesuffix("Task").removesuffix("Robot").lower()
        srv_type = srvgen.load(f"taskrpc_interfaces/srv/{type_name}")
        client = self._clients.setdefault(
            verb, self._node.create_client(srv_type, f"/robot_task/{verb}", timeout=100)
        )
        return await client.call(srv_type.Request(**fields))


@pytest.fixture
def robot():
    return LineRobot()


@pytest.fixture
async def server(robot):
    async with (
        taskrpc.Node("task_server", transport="memory") as node,
        TaskServer(node, robot, FullStore(), queue_limit=300) as server,
    ):
        yield server


@pytest.fixture
async def client(server):
    async with taskrpc.Node("alice", transport="memory") as node:
        yield Client(node)


def ids(response):
    return [task.task_id for task in response.tasks]


async def test_lectures_four_tasks_run_in_the_order_two_one_three_four():
    rows = [
        ("move", "warehouse", 8),
        ("scan", "area_a", 9),
        ("move", "station_1", 5),
        ("report", "central", 3),
    ]
    async with (
        taskrpc.Node("task_server", transport="memory") as node,
        TaskServer(node, KinematicRobot(default_world()), MemoryStore()) as server,
    ):
        client = Client(node)
        answers = [await client.submit(*row) for row in rows]
        assert [answer.message for answer in answers] == [f"Task queued: {row[0]}" for row in rows]
        assert ids(await client("ListTasks")) == [2, 1, 3, 4]
        last = server.manager.repository.find(4)
        assert answers[3].estimated_time == pytest.approx(last.accepted_estimate)
        await asyncio.sleep(last.accepted_estimate - 0.05)
        assert ids(await client("ListTasks")) == [4]
        await asyncio.sleep(0.1)
        assert ids(await client("ListTasks", all=True)) == [4, 3, 1, 2]


async def test_a_refused_task_is_answered_as_in_the_lecture(client):
    response = await client.submit("fly", "1", 5)
    assert response == RobotTask.Response(
        success=False,
        message="Invalid task: fly (expected move, scan or report)",
        task_id=-1,
        estimated_time=0.0,
    )


async def test_repeated_request_id_makes_one_task(client):
    first = await client.submit("move", "1", 5, request_id="once")
    again = await client.submit("move", "1", 5, request_id="once")
    other = await client.submit("move", "1", 5)
    assert (first.task_id, again.task_id, other.task_id) == (1, 1, 2)
    assert again == first


async def test_a_refusal_is_not_remembered_but_decided_anew(client, server):
    await client("PauseTasks")
    for _ in range(300):
        await client.submit("move", "1", 5)
    refused = await client.submit("move", "1", 5, request_id="once")
    assert refused.message.startswith("Queue full")
    await client("CancelTask", task_id=1)
    accepted = await client.submit("move", "1", 5, request_id="once")
    assert (accepted.success, accepted.task_id) == (True, 301)
    assert await client.submit("move", "1", 5, request_id="once") == accepted


async def test_shown_task_has_result_times_and_client(client):
    await client.submit("move", "3", 5)
    await asyncio.sleep(10)
    response = await client("ShowTask", task_id=1)
    task = response.task
    assert (response.success, task.state, task.result) == (True, task.SUCCEEDED, '{"x":3.0}')
    assert (task.progress, task.estimated_time) == (1.0, 0.0)
    assert task.submitted.sec <= task.started.sec <= task.ended.sec
    assert task.ended.sec > 1_700_000_000
    assert task.client


async def test_the_changes_of_an_estimate_are_shown(client):
    await client("PauseTasks")
    await client.submit("move", "3", 5)
    await client.submit("move", "3", 7)
    task = (await client("ShowTask", task_id=1)).task
    (change,) = task.estimate_changes
    assert change.cause == "task 2, priority 7, went ahead"
    assert task.estimated_time == pytest.approx(task.accepted_estimate + change.seconds)


async def test_unknown_task_id_is_reported(client):
    for type_name in (
        "ShowTask",
        "WatchTasks",
        "CancelTask",
        "RequeueTask",
        "DropTask",
    ):
        response = await client(type_name, task_id=99)
        assert (response.success, response.message) == (False, "There is no task 99")
    response = await client("ReprioritiseTask", task_id=99, priority=5)
    assert response.message == "There is no task 99"


async def test_a_long_list_comes_in_pages(client):
    await client("PauseTasks")
    for number in range(250):
        await client.submit("move", "1", 1 + number % 10)
    first = await client("ListTasks")
    second = await client("ListTasks", page=first.next_page)
    assert (len(first.tasks), len(second.tasks), second.next_page) == (200, 50, "")
    assert sorted(ids(first) + ids(second)) == list(range(1, 251))
    assert (first.queued, first.paused) == (250, True)
    with pytest.raises(taskrpc.HandlerFailed, match="page: expected `next_page`"):
        await client("ListTasks", page="nonsense")


async def test_watcher_wakes_only_for_changes(client):
    start = await client("ListTasks")
    watch = asyncio.ensure_future(client("WatchTasks", revision=start.revision, timeout=50.0))
    await asyncio.sleep(5)
    assert not watch.done()
    await client.submit("move", "1", 5)
    heard = await watch
    assert (heard.complete, ids(heard)) == (True, [1])
    assert heard.revision > start.revision


async def test_a_watcher_of_one_task_follows_it_to_its_end(client):
    await client.submit("move", "1", 5)
    revision, states = 0, []
    while not states or states[-1] not in ("SUCCEEDED", "FAILED"):
        heard = await client("WatchTasks", revision=revision, task_id=1)
        revision = heard.revision
        states += [task.state for task in heard.tasks if [task.state] != states[-1:]]
    assert states == ["QUEUED", "RUNNING", "SUCCEEDED"]


async def test_watcher_without_revision_gets_an_incomplete_response(client):
    heard = await client("WatchTasks", revision=0)
    assert (heard.complete, ids(heard)) == (False, [])


async def test_a_quiet_watch_ends_when_its_time_is_up(client):
    revision = (await client("ListTasks")).revision
    began = asyncio.get_running_loop().time()
    heard = await client("WatchTasks", revision=revision, timeout=3.0)
    assert asyncio.get_running_loop().time() - began == pytest.approx(3.0, abs=0.1)
    assert (heard.success, heard.complete, ids(heard)) == (True, True, [])


async def test_a_watch_is_answered_before_its_caller_gives_up(client, server):
    revision = (await client("ListTasks")).revision
    watch_type = srvgen.load("taskrpc_interfaces/srv/WatchTasks")
    impatient = client._node.create_client(watch_type, "/robot_task/watch")
    request = watch_type.Request(revision=revision, timeout=60.0)
    assert (await impatient.call(request, timeout=5.0)).success


async def test_a_watch_ends_with_the_server(client, server):
    revision = (await client("ListTasks")).revision
    watch = asyncio.ensure_future(client("WatchTasks", revision=revision, timeout=50.0))
    await asyncio.sleep(1)
    began = asyncio.get_running_loop().time()
    await server.close()
    assert (await watch).success
    assert asyncio.get_running_loop().time() - began < 0.1


async def test_a_server_that_ends_says_that_nothing_was_done(client, server):
    await server.close()
    with pytest.raises(taskrpc.TaskRpcError, match="the task server is ending") as error:
        await client.submit("move", "1", 5)
    assert error.value.not_executed
    assert (await server.manager.repository._store.load()).tasks == ()


async def test_tasks_are_steered_through_the_services(client, robot):
    await client.submit("move", "50", 5)
    await asyncio.sleep(5)
    await client.submit("move", "2", 5)
    await client.submit("move", "3", 5)
    assert (await client("PauseTasks")).message == "The queue is paused"
    moved = await client("ReprioritiseTask", task_id=3, priority=9)
    assert ids(await client("ListTasks")) == [1, 3, 2]
    assert moved.estimated_time > 0
    assert (await client("CancelTask", task_id=1)).success
    again = await client("RequeueTask", task_id=1)
    assert ids(await client("ListTasks")) == [3, 2, 1]
    assert again.estimated_time > 50
    assert (await client("DropTask", task_id=2)).success
    assert (await client("ResumeTasks")).message == "The queue is resumed"
    await asyncio.sleep(20)
    assert (await client("StopRobot")).message.startswith("The robot is stopped")
    assert ids(await client("ListTasks", all=True)) == [1, 3, 2]
    assert [target for _, target in robot.log] == ["50", "3", "50"]


async def test_store_failure_reaches_the_caller(client, server):
    server.manager.repository._store.is_full = True
    with pytest.raises(taskrpc.HandlerFailed, match="the disk is full"):
        await client.submit("move", "1", 5)
    server.manager.repository._store.is_full = False
    assert (await client.submit("move", "1", 5)).success


async def test_a_second_task_server_of_one_name_is_refused_and_closes_its_store(server, tmp_path):
    async with taskrpc.Node("other", transport="memory") as node:
        path = tmp_path / "tasks.db"
        other = TaskServer(node, LineRobot(), SqliteStore(path))
        with pytest.raises(taskrpc.NameInUse):
            await other.start()
    store = SqliteStore(path)
    assert (await store.load()).tasks == (), "the file is free again"
    await store.close()


async def test_task_server_that_cannot_start_closes_its_store(tmp_path):
    class UnreadableStore(SqliteStore):
        async def load(self):
            raise taskrpc.StoreError("the file cannot be read")

    path = tmp_path / "tasks.db"
    async with taskrpc.Node("one", transport="memory") as node:
        with pytest.raises(taskrpc.StoreError, match="cannot be read"):
            await TaskServer(node, LineRobot(), UnreadableStore(path)).start()
        async with TaskServer(node, LineRobot(), SqliteStore(path)) as again:
            assert (await again.manager.submit("move", "1", 5)).success


async def test_a_fresh_start_forgets_the_tasks_of_the_server_before():
    store = MemoryStore()
    async with taskrpc.Node("one", transport="memory") as node:
        server = TaskServer(node, LineRobot(), store)
        await server.start()
        await server.manager.submit("move", "1", 5)
        await server.close()
        again = TaskServer(node, LineRobot(), store, service_name="again")
        assert await again.start(fresh=True) == Resumed(0, ())
        assert (await again.manager.submit("move", "1", 5)).task_id == 1
        await again.close()


async def test_a_server_can_go_by_another_name():
    stop_type = srvgen.load("taskrpc_interfaces/srv/StopRobot")
    async with (
        taskrpc.Node("depot", transport="memory") as node,
        TaskServer(node, LineRobot(), MemoryStore(), service_name="/depot/tasks"),
    ):
        client = node.create_client(RobotTask, "/depot/tasks")
        request = RobotTask.Request(task_type="move", target="1", priority=5)
        assert (await client.call(request)).success
        stop = node.create_client(stop_type, "/depot/tasks/stop")
        assert (await stop.call(stop_type.Request())).success


@pytest.mark.parametrize("wrong", [3e9, -3e9])
async def test_a_clock_that_is_wrong_by_decades_keeps_nothing_from_being_shown(robot, wrong):
    async with (
        taskrpc.Node("task_server", transport="memory") as node,
        TaskServer(node, robot, MemoryStore(), wall_clock=lambda: wrong),
    ):
        client = Client(node)
        await client.submit("move", "3", 5)
        await asyncio.sleep(100)
        (task,) = (await client("ListTasks", all=True)).tasks
        assert task.state == "SUCCEEDED"
        assert abs(task.submitted.sec) > 2e9
        assert (await client("ShowTask", task_id=1)).success
