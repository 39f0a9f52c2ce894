"""`taskrpc top` reads programs, the queue and the robot without disturbing them."""

from __future__ import annotations

import asyncio
import contextlib

import pytest

import srvgen
import taskrpc
from taskrpc.cli.observe.top.picture import picture, text_of
from taskrpc.observe.top.model import Pose
from taskrpc.observe.top.reading import Reader
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks import MemoryStore, TaskServer


@contextlib.asynccontextmanager
async def task_server(**options):
    # A program of its own, so that `top` does not share its endpoint.
    async with taskrpc.Node("task_server", transport="memory", listen="server", **options) as node:
        server = TaskServer(node, KinematicRobot(default_world()), MemoryStore())
        await server.start()
        try:
            yield server
        finally:
            await server.close()


@contextlib.asynccontextmanager
async def top(period=1.0, **options):
    async with taskrpc.Node("_top", transport="memory", listen="top", **options) as node:
        yield Reader(node, address="", period=period, hidden=False)


async def submit(node, target, priority):
    robot_task = srvgen.load("my_robot_interfaces/srv/RobotTask")
    client = node.create_client(robot_task, "/robot_task")
    request = robot_task.Request(task_type="move", target=target, priority=priority)
    return await client.call(request)


async def test_queue_and_robot_are_read():
    async with (
        task_server(),
        taskrpc.Node("ada", transport="memory", listen="ada") as ada,
        top() as reader,
    ):
        await reader.read()
        await submit(ada, "warehouse", 8)
        await asyncio.sleep(1)
        await submit(ada, "dock", 3)
        await submit(ada, "central", 10)
        await asyncio.sleep(1)
        view = await reader.read()
        (server,) = view.task_servers
        assert [task.work for task in server.tasks] == [
            "move warehouse",
            "move central",
            "move dock",
        ]
        assert (server.state, server.queued, server.tasks[0].client) == ("working", 2, "/ada")
        assert server.pose is not None
        first = server.pose
        await asyncio.sleep(1)
        assert (await reader.read()).task_servers[0].pose != first
        row = next(row for row in view.services if row.name == "/robot_task")
        assert row.codes == {0: 3}
        assert {node.name: node.calls_out for node in view.nodes}["/ada"] == pytest.approx(1.5)


async def test_its_own_calls_do_not_count():
    async with task_server(), top() as reader:
        for _ in range(5):
            view = await reader.read()
            await asyncio.sleep(1)
        assert view.per_second == 0
        assert all(not row.codes for row in view.services)
        assert [row.name for row in view.nodes] == ["/task_server"]


async def test_pose_of_a_robot_that_stands_is_known():
    async with task_server() as server, top() as reader:
        await reader.read()
        await asyncio.sleep(0.5)
        (row,) = (await reader.read()).task_servers
        pose = server.manager.pose()
        assert row.pose == pytest.approx(Pose(pose.x, pose.y, pose.theta))
        assert row.state == "idle"


async def test_a_task_server_that_ends_disappears():
    async with top() as reader:
        async with task_server():
            assert len((await reader.read()).task_servers) == 1
        view = await reader.read()
        assert (view.task_servers, view.services, view.nodes) == ((), (), ())
        async with task_server():
            assert len((await reader.read()).task_servers) == 1


async def test_a_task_server_that_refuses_shows_the_reason():
    def refuse(request, response):
        raise taskrpc.HandlerError("PERMISSION_DENIED", "no\x1b[2J lists today")

    async with taskrpc.Node("server", transport="memory", listen="server") as node, top() as reader:
        list_tasks = srvgen.load("taskrpc_interfaces/srv/ListTasks")
        robot_task = srvgen.load("my_robot_interfaces/srv/RobotTask")
        node.create_service(robot_task, "/robot_task", lambda request, response: response)
        node.create_service(list_tasks, "/robot_task/list", refuse)
        view = await reader.read()
        shown = "\n".join(map(text_of, picture(view)))
        assert "\x1b" not in shown
        (line,) = [line for line in shown.splitlines() if "lists today" in line]
        assert line.startswith("/robot_task  ! ")


async def test_a_silent_program_does_not_delay_a_reading_beyond_its_period(monkeypatch):
    async with (
        taskrpc.Node("server", transport="memory", listen="server") as node,
        top(0.5) as reader,
    ):
        add = srvgen.load("example_interfaces/srv/AddTwoInts")
        node.create_service(add, "add", lambda request, response: response)
        await reader.read()
        from taskrpc.core.transport.connection.server_side import ServingConnection
        from taskrpc.core.wire.events import ResolveReceived

        monkeypatch.setitem(ServingConnection.handlers, ResolveReceived, lambda *_: None)
        began = asyncio.get_running_loop().time()
        view = await reader.read()
        assert asyncio.get_running_loop().time() - began <= 0.5
        assert view.nodes[0].problem == "it did not respond in time"


async def test_account_with_the_role_observe_sees_everything_and_cannot_control():
    ana = taskrpc.Account("ana", "s" * 20, role=taskrpc.Role.OBSERVE)
    bo = taskrpc.Account("bo", "t" * 20, role=taskrpc.Role.SUBMIT)
    async with (
        task_server(accounts=taskrpc.Accounts([ana, bo])) as server,
        taskrpc.Node("bo", transport="memory", listen="bo", token=bo.token) as user,
        taskrpc.Node("ana", transport="memory", listen="ana", token=ana.token) as observer,
        top(token=ana.token) as reader,
    ):
        await reader.read()
        await submit(user, "warehouse", 8)
        await asyncio.sleep(1)
        view = await reader.read()
        [shown] = view.task_servers
        assert (shown.problem, [task.work for task in shown.tasks]) == ("", ["move warehouse"])
        assert shown.pose is not None
        assert next(row for row in view.services if row.name == "/robot_task").codes == {0: 1}
        with pytest.raises(taskrpc.PermissionDenied, match="the account ana has observe"):
            await submit(observer, "dock", 3)
        pause = srvgen.load("taskrpc_interfaces/srv/PauseTasks")
        with pytest.raises(taskrpc.PermissionDenied, match="the account ana has observe"):
            await observer.create_client(pause, "/robot_task/pause").call(pause.Request())
        assert not server.manager.is_paused
