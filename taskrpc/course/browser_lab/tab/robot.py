"""The robot of the tab: a task server in memory, and what the map shows of it."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from typing import Any

import msgspec

import srvgen
from taskrpc.course.browser_lab.tab.programs import Emit
from taskrpc.node import Node
from taskrpc.observe.web.live import TICK, LiveTasks
from taskrpc.robot.driver import KinematicRobot
from taskrpc.robot.mapfile import default_world
from taskrpc.robot.tasks.page_events import PROTOCOL, map_json
from taskrpc.robot.tasks.records.store import MemoryStore
from taskrpc.robot.tasks.server import TaskServer


class TabRobot:
    """A robot whose pose, path and tasks are sent to the page; `service` is its service."""

    def __init__(self, emit: Emit, service: str = "robot_task") -> None:
        self._emit = emit
        self._service = service
        self._robot = KinematicRobot(default_world())

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Offer the service during the block."""
        self._show_map()
        async with (
            Node("task_server", transport="memory") as node,
            TaskServer(node, self._robot, MemoryStore(), service_name=self._service) as server,
        ):
            showing = asyncio.create_task(self._show(server))
            try:
                yield
            finally:
                showing.cancel()

    async def move(self, x: float, y: float) -> str:
        """Submit a task as any client does; returns the server's message."""
        robot_task = srvgen.load("my_robot_interfaces/srv/RobotTask")
        request = robot_task.Request(task_type="move", target=f"{x:.2f},{y:.2f}", priority=5)
        async with Node("page", transport="memory") as node:
            client = node.create_client(robot_task, self._service)
            return str((await client.call(request)).message)

    def _show_map(self) -> None:
        about = {"service": f"/{self._service}", "started": time.time(), "speed": 1.0}
        world = map_json(self._robot.world)
        hello = {"protocol": PROTOCOL, "server": about, "control": True, "now": time.time()}
        self._emit("robot", name="hello", data=hello | {"map": world})

    async def _show(self, server: TaskServer) -> None:
        live = LiveTasks(server.manager)
        loop = asyncio.get_running_loop()
        while True:
            for event in live.events(loop.time(), time.time()):
                data: Any = msgspec.json.decode(event.json)
                self._emit("robot", name=event.name, data=data)
            await asyncio.sleep(TICK)
