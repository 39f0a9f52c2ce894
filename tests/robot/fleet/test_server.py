import asyncio

import pytest

import srvgen
from taskrpc.errors import Code, HandlerFailed, StoreError, TaskRpcError
from taskrpc.node import Node
from taskrpc.robot.fleet import FleetServer, FleetSettings, MemoryFleet, MemoryFleetStore
from tests.robot.tasks.fakes import LineRobot

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
ListTasks = srvgen.load("taskrpc_interfaces/srv/ListTasks")
PauseTasks = srvgen.load("taskrpc_interfaces/srv/PauseTasks")
ResumeTasks = srvgen.load("taskrpc_interfaces/srv/ResumeTasks")
StopRobot = srvgen.load("taskrpc_interfaces/srv/StopRobot")
Trigger = srvgen.load("std_srvs/srv/Trigger")


class Lab:
    """Servers of a fleet on nodes in memory, and a client."""

    def __init__(self):
        loop = asyncio.get_running_loop()
        self.database = MemoryFleet(lambda: 1000.0 + loop.time())
        self.servers, self.nodes = {}, {}
        self.client = Node("client", transport="memory")

    async def add(self, name, **settings):
        node = self.nodes[name] = Node(f"server_{name}", transport="memory", listen=name)
        await node.start()
        known = FleetSettings(name=name, settle=0.0, **settings)
        server = FleetServer(node, LineRobot(), MemoryFleetStore(self.database), known)
        await server.start()
        self.servers[name] = server
        return server

    async def end(self, name):
        """End a server as a crash would, only without the wait for its lease."""
        server, node = self.servers.pop(name), self.nodes.pop(name)
        await node.destroy()
        await server.close()

    async def call(self, srv, name="/robot_task", request_id=None, **fields):
        client = self.client.create_client(srv, name, timeout=30)
        try:
            return await client.call(srv.Request(**fields), request_id=request_id)
        finally:
            client.destroy()

    async def submit(self, target="3", **options):
        return await self.call(RobotTask, task_type="move", target=target, priority=5, **options)


@pytest.fixture
async def lab():
    lab = Lab()
    async with lab.client:
        yield lab
        for name in list(lab.servers):
            await lab.end(name)


async def test_all_servers_offer_one_name_and_each_its_own(lab):
    await lab.add("r1")
    await lab.add("r2")
    assert (await lab.submit()).success
    for name in ("/r1/robot_task", "/r2/robot_task"):
        response = await lab.call(ListTasks, f"{name}/list")
        assert [task.task_id for task in response.tasks] == [1]
        assert (await lab.call(Trigger, f"{name}/health")).message.endswith("2 robots")


async def test_each_server_offers_the_action_below_its_robots_name(lab):
    await lab.add("r1")
    await lab.add("r2")
    ExecuteTask = srvgen.load("my_robot_interfaces/action/ExecuteTask")
    client = lab.client.create_action_client(ExecuteTask, "/r1/robot_task/execute", timeout=30)
    assert await client.wait_for_server(60)
    assert not await lab.client.create_action_client(
        ExecuteTask, "/robot_task/execute"
    ).wait_for_server(1)
    goals = [
        ExecuteTask.Goal(task_type="move", target=str(target), priority=5) for target in (5, 6, 7)
    ]
    handles = [await client.send_goal(goal) for goal in goals]
    for number, handle in enumerate(handles, 1):
        states = {each.state async for each in handle.feedback}
        assert states <= {"QUEUED", "RUNNING"}
        assert "RUNNING" in states
        result = await handle.result(600)
        assert (result.state, result.task_id) == ("SUCCEEDED", number)
    robots = {task.robot for task in lab.servers["r1"].manager.repository.tasks()}
    assert robots == {"r1", "r2"}  # any robot executes the task of a goal


async def test_repeated_request_that_reaches_another_server_gets_the_stored_response(lab):
    await lab.add("r1")
    first = await lab.submit(request_id="order 7")
    await lab.add("r2")
    await lab.end("r1")
    again = await lab.submit(request_id="order 7")
    assert (again.task_id, again.estimated_time) == (first.task_id, first.estimated_time)
    assert list(lab.database.tasks) == [1]


async def test_client_continues_its_numbers_at_another_server(lab):
    await lab.add("r1")
    client = lab.client.create_client(RobotTask, "/robot_task", timeout=30)
    request = RobotTask.Request(task_type="move", target="1", priority=5)
    await client.call(request)
    await lab.add("r2")
    await lab.end("r1")
    assert [(await client.call(request)).task_id for _ in range(2)] == [2, 3]


async def test_request_that_another_server_completes_meanwhile_is_stored_once(lab):
    server = await lab.add("r1")
    store = server.manager.store
    first = await lab.submit(request_id="order 7")
    key = None

    async def learns_nothing(client):
        nonlocal key
        key = client
        return []

    await lab.add("r2")
    lab.servers["r2"].manager.store.look_up = learns_nothing
    await lab.end("r1")
    again = await lab.submit(request_id="order 7")
    assert key is not None
    assert again.task_id == first.task_id
    assert list(lab.database.tasks) == [1]
    assert store is not lab.servers["r2"].manager.store


async def test_refusal_is_not_stored(lab):
    await lab.add("r1", capabilities="move:1")
    assert not (await lab.submit("5", request_id="order 7")).success
    assert lab.database.completions.all() == ()


async def test_without_the_database_a_submission_fails_and_lists_show_the_last_known(lab):
    server = await lab.add("r1")
    await lab.submit("30")
    server.manager.store.is_cut_off = True
    for options in ({}, {"request_id": "order 7"}):
        with pytest.raises(HandlerFailed, match="the database cannot be reached") as caught:
            await lab.submit(**options)
        assert caught.value.code is Code.UNAVAILABLE
        assert caught.value.not_executed  # so a client may repeat the call
    assert len((await lab.call(ListTasks, "/robot_task/list")).tasks) == 1
    health = await lab.call(Trigger, "/robot_task/health")
    assert (health.success, health.message) == (False, "not ready: the database cannot be reached")
    server.manager.store.is_cut_off = False


async def test_server_without_a_lease_is_not_ready(lab):
    server = await lab.add("r1")
    server.manager.lease.epoch, epoch = 0, server.manager.lease.epoch
    health = await lab.call(Trigger, "/robot_task/health")
    assert health.message == "not ready: r1 has no lease now"
    server.manager.lease.epoch = epoch


async def test_list_names_the_robots(lab):
    await lab.add("r1")
    await lab.submit("30")
    await lab.submit("30")
    await asyncio.sleep(1)
    tasks = (await lab.call(ListTasks, "/robot_task/list")).tasks
    assert [(task.state, task.robot) for task in tasks] == [("RUNNING", "r1"), ("QUEUED", "r1")]


async def test_second_robot_of_a_name_does_not_start(lab):
    await lab.add("r1")
    with pytest.raises(TaskRpcError, match=r"already offered by .*--robot-name$"):
        await lab.add("r1")
    await lab.nodes["r1"].destroy()


async def test_request_for_one_robot_is_taken_by_any_server(lab):
    await lab.add("r1")
    await lab.add("r2")
    for kind, verb, said in (
        (PauseTasks, "pause", "r2 is paused; the other robots continue"),
        (ResumeTasks, "resume", "r2 is resumed"),
        (StopRobot, "stop", "r2 is stopped and paused; the other robots continue"),
    ):
        response = await lab.call(kind, f"/r1/robot_task/{verb}", robot="r2")
        assert (response.success, response.message) == (True, said)
    unknown = await lab.call(PauseTasks, "/r1/robot_task/pause", robot="r9")
    assert not unknown.success
    assert "expected one of: r1, r2" in unknown.message


async def test_list_says_which_robot_a_task_waits_for(lab):
    await lab.add("r1", capabilities="scan")
    await lab.add("r2", capabilities="move")
    await lab.call(PauseTasks, "/r1/robot_task/pause", robot="r2")
    assert (await lab.submit()).message == "Task queued: move (waits for r2, which is paused)"
    [task] = (await lab.call(ListTasks, "/r1/robot_task/list")).tasks
    assert task.message == "waits for r2, which is paused"


async def test_server_whose_database_cannot_be_used_offers_nothing(lab, monkeypatch):
    async def cannot_be_used(store):
        raise StoreError("the database lacks a table")

    monkeypatch.setattr(MemoryFleetStore, "store_id", cannot_be_used)
    monkeypatch.setattr(FleetServer, "_offer", lambda *_, **__: pytest.fail("it was offered"))
    with pytest.raises(StoreError, match="lacks a table"):
        await lab.add("r1")
