"""The reset of a running server: tasks, archive, last calls, and who may call it."""

import asyncio
import json
from pathlib import Path

import pytest

import srvgen
import taskrpc
from taskrpc.cli.course.classroom.group import GroupReset
from taskrpc.core.security.roles import Account, Accounts
from taskrpc.course.classroom.attendance import Attendance, last_calls
from taskrpc.course.classroom.register import Register
from taskrpc.errors import StoreError
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks import MemoryStore, TaskServer

Trigger = srvgen.load("std_srvs/srv/Trigger")
RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
ADA = Account("ada", "s" * 20)


@pytest.fixture
async def scene(tmp_path):
    """A server of a class in memory, and what it forgets."""
    register = Register(tmp_path / "class")
    register.add(["ada"], 1e12)
    attendance, forgotten = Attendance(register.attendance_file, lambda: 50.0), []
    node = taskrpc.Node(
        "task_server",
        transport="memory",
        accounts=Accounts([ADA]),
        observer=attendance,
        namespace="/",
    )
    robot = KinematicRobot(default_world())
    async with node, TaskServer(node, robot, MemoryStore()) as server:
        reset = GroupReset(server, register, attendance, lambda: forgotten.append(1), lambda: 60.0)
        reset.offer(node)
        yield server, register, forgotten


async def call(token="", service="/robot_task/reset", request=None):
    async with taskrpc.Node("caller", namespace="/", transport="memory", token=token) as node:
        client = node.create_client(Trigger if request is None else RobotTask, service)
        return await client.call(Trigger.Request() if request is None else request)


async def test_reset_archives_the_tasks_and_forgets_the_group(scene):
    server, register, forgotten = scene
    request = RobotTask.Request(task_type="move", target="warehouse", priority=5)
    for _ in range(3):
        assert (await call(f"ada.{ADA.secret}", "/robot_task", request)).success
    await asyncio.sleep(1)
    assert last_calls(register.attendance_file) == {"ada": 50.0}
    response = await call()
    assert response.success
    assert "3 tasks of the former group: " in response.message
    archive = json.loads(Path(response.message.rpartition(": ")[2]).read_bytes())
    assert [task["client"] for task in archive["tasks"]] == ["ada"] * 3
    assert [student["name"] for student in archive["students"]] == ["ada"]
    assert last_calls(register.attendance_file) == {}
    assert forgotten == [1]
    assert not server.manager.queue


async def test_student_may_not_reset(scene):
    with pytest.raises(taskrpc.PermissionDenied, match="needs the role admin"):
        await call(f"ada.{ADA.secret}")


async def test_archive_that_cannot_be_written_keeps_the_tasks(scene):
    server, register, forgotten = scene
    await server.manager.submit("move", "warehouse", 5)
    (register.folder / "archive").mkdir(mode=0o700)
    (register.folder / "archive").rmdir()

    def refuse(*_, **__):
        raise OSError(28, "No space left on device", "a.json")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("taskrpc.cli.course.classroom.group.write_archive", refuse)
        with pytest.raises(taskrpc.HandlerFailed, match=r"tasks are kept \(a.json: No space left"):
            await call()
    assert len([*server.manager.repository.tasks()]) == 1
    assert forgotten == []


async def test_store_that_fails_is_the_callers_error(scene, monkeypatch):
    async def fail(manager):
        raise StoreError("the disk is full")

    monkeypatch.setattr("taskrpc.cli.course.classroom.group.begin_again", fail)
    with pytest.raises(taskrpc.HandlerFailed, match="the disk is full"):
        await call()
