"""The task server's topics: what changes among the tasks, and where the robot is.

Nothing is done for them as long as nobody subscribes.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Coroutine
from typing import Any

import srvgen
from taskrpc.node import Node
from taskrpc.qos import QoS
from taskrpc.robot.protocol import Pose
from taskrpc.tasks.manager import TaskManager
from taskrpc.tasks.messages import Messages
from taskrpc.topic import Publisher

POSE_PERIOD = 0.1
"""Seconds between two poses of a robot that moves."""
EVENT_PERIOD = 0.02
"""Seconds between two messages about tasks, at least; what changes meanwhile goes together."""
MOST_TASKS = 100
"""Tasks that one message tells of; of more it says so."""
_FRAME = "map"
_LATEST = QoS(1, durability="transient_local")
_FOR_EVER = 86_400.0


class TaskNews:
    """Publishes `SERVICE/events` and `SERVICE/pose`."""

    def __init__(
        self, node: Node, manager: TaskManager, messages: Messages, service_name: str
    ) -> None:
        self._manager = manager
        self._messages = messages
        self._events_type = srvgen.load("taskrpc_interfaces/msg/TaskEvents")
        self._pose_type = srvgen.load("geometry_msgs/msg/PoseStamped")
        self._parts = [
            _Part(node, self._events_type, f"{service_name}/events", self._tell_events),
            _Part(node, self._pose_type, f"{service_name}/pose", self._tell_pose),
        ]

    def close(self) -> None:
        """Publish no more."""
        for part in self._parts:
            part.close()

    async def _tell_events(self, publisher: Publisher[Any]) -> None:
        board, running = self._manager.board, self._manager.running
        revision = board.revision
        publisher.publish(self._events([] if running is None else [running.task_id], revision))
        while not board.is_closed:
            await board.wait_for_change(revision, _FOR_EVER)
            await asyncio.sleep(EVENT_PERIOD)
            changed, revision = board.changed_since(revision), board.revision
            publisher.publish(self._events(changed, revision))

    def _events(self, changed: list[int] | None, revision: int) -> Any:
        manager = self._manager
        complete = changed is not None and len(changed) <= MOST_TASKS
        manager.reckon()
        found = [manager.book.find(task_id) for task_id in changed or () if complete]
        return self._events_type(
            revision=revision,
            complete=complete,
            paused=manager.is_paused,
            queued=len(manager.queue),
            running=0 if manager.running is None else manager.running.task_id,
            tasks=[
                self._messages.task_info(task, manager.estimate(task.task_id))
                for task in found
                if task is not None
            ],
        )

    async def _tell_pose(self, publisher: Publisher[Any]) -> None:
        board, last = self._manager.board, None
        while not board.is_closed:
            pose, revision = self._manager.pose(), board.revision
            if pose != last:
                publisher.publish(self._stamped(pose))
            elif self._manager.running is None:  # it moves again only with a task
                await board.wait_for_change(revision, _FOR_EVER)
            last = pose
            await asyncio.sleep(POSE_PERIOD)

    def _stamped(self, pose: Pose) -> Any:
        message = self._pose_type()
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(time.time_ns(), 10**9)
        message.header.frame_id = _FRAME
        message.pose.position.x, message.pose.position.y = pose.x, pose.y
        message.pose.orientation.z = math.sin(pose.theta / 2)
        message.pose.orientation.w = math.cos(pose.theta / 2)
        return message


class _Part:
    """One publisher, and the task that feeds it while somebody subscribes."""

    def __init__(
        self,
        node: Node,
        msg_type: Any,
        topic: str,
        tell: Callable[[Publisher[Any]], Coroutine[Any, Any, None]],
    ) -> None:
        self._tell = tell
        self._task: asyncio.Task[None] | None = None
        self._publisher = node.create_publisher(msg_type, topic, _LATEST)
        self._publisher.on_matched = self._matched

    def close(self) -> None:
        """Publish no more."""
        self._stop()
        self._publisher.destroy()

    def _matched(self) -> None:
        if not self._publisher.get_subscription_count():
            self._stop()
        elif self._task is None:
            # What was kept for latecomers is of before nobody looked.
            self._publisher.forget_latched()
            self._task = asyncio.get_running_loop().create_task(self._tell(self._publisher))

    def _stop(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._publisher.forget_latched()
