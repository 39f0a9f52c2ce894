"""A run of the task server with every kind of decision, recorded in virtual time."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

import pytest

import srvgen
import taskrpc
from taskrpc.observe.recording.run_recorder import RunRecorder
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks import MemoryStore, TaskServer
from taskrpc.testing.clock import VirtualTimeLoop

START = 1_700_000_000
"""The time of day at which the run begins, in seconds since 1970."""

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")


class Run:
    """A recorded task server on virtual time, and a client of it."""

    def __init__(self, path, **options):
        self.path = path
        loop = asyncio.get_running_loop()
        self.began = loop.time()
        self.clock = lambda: START + loop.time() - self.began
        self.recorder = RunRecorder(path, clock=lambda: round(self.clock() * 1e9))
        self.robot = KinematicRobot(default_world())
        self.robot.keep_journal(self.recorder.journal)
        self.options = options

    async def __aenter__(self):
        self.node = taskrpc.Node(
            "task_server", transport="memory", token="server", observer=self.recorder.calls
        )
        await self.node.start()
        self.server = TaskServer(
            self.node,
            self.robot,
            MemoryStore(),
            wall_clock=self.clock,
            journal=self.recorder.journal,
            **self.options,
        )
        await self.server.start()
        await self.recorder.follow(self.node, self.server)
        self.caller = taskrpc.Node("ada", transport="memory", token="ada")
        await self.caller.start()
        return self

    async def __aexit__(self, *error):
        await self.server.close()
        await self.recorder.close()
        await self.caller.destroy()
        await self.node.destroy()

    async def submit(self, task_type, target, priority):
        client = self.caller.create_client(RobotTask, "/robot_task")
        request = RobotTask.Request(task_type=task_type, target=target, priority=priority)
        response = await client.call(request)
        client.destroy()
        return response.task_id

    async def call(self, verb, type_name, **fields):
        srv_type = srvgen.load(f"taskrpc_interfaces/srv/{type_name}")
        client = self.caller.create_client(srv_type, f"/robot_task/{verb}")
        response = await client.call(srv_type.Request(**fields))
        client.destroy()
        return response


@pytest.fixture(scope="session")
def _recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    record_run(path)
    return path


@pytest.fixture
def recorded_run(_recorded, tmp_path):
    """The path of a recording with every kind of decision; each test gets a copy."""
    return Path(shutil.copy(_recorded, tmp_path))


def record_run(path):
    """Record a run with every kind of decision, on virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(_record(path))


async def _record(path):
    async with Run(path) as run:
        first = await run.submit("move", "warehouse", 5)
        await run.submit("scan", "central", 5)
        ahead = await run.submit("report", "3,4", 9)
        cancelled = await run.submit("move", "station_1", 3)
        await run.submit("fly", "home", 3)
        await asyncio.sleep(2)
        await run.call("pause", "PauseTasks")
        await asyncio.sleep(1)
        await run.call("resume", "ResumeTasks")
        await run.call("reprioritise", "ReprioritiseTask", task_id=cancelled, priority=10)
        await run.call("cancel", "CancelTask", task_id=cancelled)
        await asyncio.sleep(25)
        moving = await run.submit("move", "dock", 5)
        await asyncio.sleep(1)
        await run.call("cancel", "CancelTask", task_id=moving)
        await run.call("requeue", "RequeueTask", task_id=moving)
        await asyncio.sleep(1)
        await run.call("stop", "StopRobot")
        await run.call("resume", "ResumeTasks")
        await run.submit("scan", "area_a", 1)
        await asyncio.sleep(30)
        await run.submit("move", "warehouse", 1)
        await asyncio.sleep(1)
    assert (first, ahead) == (1, 3)
