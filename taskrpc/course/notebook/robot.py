"""A simulated robot inside a notebook: a task server without a terminal."""

from __future__ import annotations

import taskrpc.sync
from taskrpc.course.notebook.calls import CallList
from taskrpc.robot.driver import KinematicRobot
from taskrpc.robot.mapfile import default_world, read_map
from taskrpc.robot.tasks.records.store import MemoryStore
from taskrpc.robot.tasks.server import TaskServer
from taskrpc.robot.world import World

NAME = "task_server"
"""The name of its node."""


class NotebookRobot:
    """A robot with its task server `/robot_task`, whose tasks are kept in memory.

    Args:
        calls: gets its calls.
        speed: robot seconds that pass in one real second.
        map: the path of a map file; "" for the bundled map.
    """

    def __init__(self, calls: CallList, speed: float = 1.0, map: str = "") -> None:
        self.world: World = read_map(map) if map else default_world()
        self._robot = KinematicRobot(self.world, speed=speed)
        self._node = taskrpc.sync.Node(NAME, observer=calls)
        self._server: TaskServer | None = None

    def start(self) -> None:
        """Offer the services. Raises NameInUse if another program offers them."""
        self._node.start()
        try:
            self._node.loop_thread.run(self._start(), "start_robot()")
        except BaseException:
            self._node.close()
            raise

    def stop(self) -> None:
        """Halt the robot and withdraw the services; the tasks are forgotten."""
        if self._server is not None:
            server, self._server = self._server, None
            self._node.loop_thread.run(server.close(), "stop()")
            self._node.close()

    async def _start(self) -> None:
        server = TaskServer(self._node.async_node, self._robot, MemoryStore())
        await server.start()
        self._server = server
