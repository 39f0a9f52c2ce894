"""Reads what `taskrpc top` shows: statistics of programs, queues and poses of task servers."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import srvgen
from taskrpc.errors import TaskRpcError
from taskrpc.observe.texts import printable, work_of
from taskrpc.observe.top.model import History, Pose, TaskRow, TaskServerRow, View
from taskrpc.qos import QoS
from taskrpc.spi import ProgramStatistics, RegistryEntry, domain_id, suggestions

if TYPE_CHECKING:
    from taskrpc.client import Client
    from taskrpc.node import Node
    from taskrpc.topic import Subscription

_TASK_SERVICE = "my_robot_interfaces/srv/RobotTask"
_LIST_TASKS = "taskrpc_interfaces/srv/ListTasks"
_MOST_TASKS = 50  # tasks that are read; more do not fit on a terminal
_MOST_SERVERS = 4  # task servers that are read
_LONGEST = 2.0  # seconds that programs get to answer


class Reader:
    """Reads all programs that a node sees.

    Args:
        node: a started node; the caller closes it.
        address: the address of the only program to watch, "" for those of this machine.
        period: seconds between two readings. Silent programs delay a reading for at most 0.8 of it.
        hidden: whether services and nodes with hidden names are shown.
    """

    def __init__(self, node: Node, *, address: str, period: float, hidden: bool) -> None:
        self.programs: list[ProgramStatistics] = []
        """The last reading."""
        self._node = node
        self._address = address
        self._timeout = min(_LONGEST, max(0.2, 0.8 * period))
        self._history = History(hidden=hidden)
        self._task_servers: dict[str, TaskServerReader] = {}

    async def read(self) -> View:
        """Ask all programs, and return what they show together with the earlier readings."""
        self.programs = await self._node.statistics(self._timeout)
        self._history.add(self.programs)
        servers = self._servers(self.programs)
        rows = await asyncio.gather(*(each.read() for each in servers))
        is_alone = not self._address and not any(each.entry.nodes for each in self.programs)
        return self._history.view(
            time.time(),
            domain=domain_id(),
            address=self._address,
            task_servers=rows,
            elsewhere=suggestions.domains() if is_alone else (),
        )

    def _servers(self, programs: Sequence[ProgramStatistics]) -> list[TaskServerReader]:
        """Return the task servers that answered just now, sorted by name."""
        answered = [each.entry for each in programs if each.statistics is not None]
        found = task_services(answered)
        for name in set(self._task_servers).difference(found):
            self._task_servers.pop(name).close()
        for name in found[:_MOST_SERVERS]:
            if name not in self._task_servers:
                self._task_servers[name] = TaskServerReader(self._node, name, self._timeout)
        return [self._task_servers[name] for name in found[:_MOST_SERVERS]]


class TaskServerReader:
    """Reads one task server: calls its list, and subscribes to the robot's pose.

    Args:
        node: a started node; the caller closes it.
        service: the name of the service that accepts tasks.
        timeout: seconds that the server gets to answer.
    """

    def __init__(self, node: Node, service: str, timeout: float) -> None:
        self._service = service
        self._timeout = timeout
        self._pose: Pose | None = None
        self._type: Any = srvgen.load(_LIST_TASKS)
        self._client: Client[Any, Any] = node.create_client(self._type, f"{service}/list")
        latest = QoS(1, durability="transient_local")
        pose = srvgen.load("geometry_msgs/msg/PoseStamped")
        self._subscription: Subscription[Any] = node.create_subscription(
            pose, f"{service}/pose", self._moved, latest, on_mismatch=lambda _: None
        )

    def close(self) -> None:
        """Forget the server."""
        self._client.destroy()
        self._subscription.destroy()

    async def read(self) -> TaskServerRow:
        """Return the queue and the robot; a row with a problem if the server does not answer."""
        try:
            request = self._type.Request(limit=_MOST_TASKS)
            response = await self._client.call(request, timeout=self._timeout)
        except (OSError, TaskRpcError) as error:
            return TaskServerRow(self._service, problem=printable(str(error)))
        tasks = tuple(_task_row(task) for task in response.tasks)
        return TaskServerRow(self._service, response.paused, response.queued, tasks, self._pose)

    def _moved(self, message: Any) -> None:
        position, orientation = message.pose.position, message.pose.orientation
        theta = 2 * math.atan2(orientation.z, orientation.w)
        self._pose = Pose(position.x, position.y, theta)


def task_services(programs: Iterable[RegistryEntry]) -> list[str]:
    """Return the names under which programs accept tasks, sorted."""
    found = set()
    for program in programs:
        types = {each.name: each.type_name for each in program.services}
        found |= {
            name
            for name, type_name in types.items()
            if type_name == _TASK_SERVICE and types.get(f"{name}/list") == _LIST_TASKS
        }
    return sorted(found)


def _task_row(task: Any) -> TaskRow:
    return TaskRow(
        task.task_id,
        work_of(task),
        task.priority,
        task.state,
        task.progress,
        task.estimated_time,
        printable(task.client),
    )
