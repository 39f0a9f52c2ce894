"""The task server's topics: changes of the tasks, and the robot's pose.

The server publishes only while a topic has subscribers.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, Generic

import srvgen
from taskrpc.message_types import MsgT
from taskrpc.node import Node
from taskrpc.qos import QoS
from taskrpc.robot.protocol import Pose
from taskrpc.robot.tasks.managed import ManagedTasks
from taskrpc.robot.tasks.responses import TaskMessages
from taskrpc.spi import time_of_day_ns
from taskrpc.topic import Publisher

if TYPE_CHECKING:
    from srvgen.stubs.geometry_msgs.msg import PoseStamped
    from srvgen.stubs.taskrpc_interfaces.msg import TaskEvents

POSE_PERIOD = 0.1
"""Seconds between two poses of a moving robot."""
EVENT_PERIOD = 0.02
"""Minimum seconds between two events messages; changes within it share one message."""
MOST_TASKS = 100
"""The most tasks in one events message; after more changes it says that it is incomplete."""
_FRAME = "map"
_LATEST = QoS(1, durability="transient_local")
_NO_TIMEOUT = 86_400.0


class TaskTopics:
    """Publishes `SERVICE/events` and `SERVICE/pose`."""

    def __init__(
        self, node: Node, manager: ManagedTasks, messages: TaskMessages, service_name: str
    ) -> None:
        self._manager = manager
        self._messages = messages
        self._events_type = srvgen.load("taskrpc_interfaces/msg/TaskEvents")
        self._pose_type = srvgen.load("geometry_msgs/msg/PoseStamped")
        events = f"{service_name}/events"
        self._topics: tuple[_OnDemandTopic[TaskEvents], _OnDemandTopic[PoseStamped]] = (
            _OnDemandTopic(node, self._events_type, events, self._publish_events),
            _OnDemandTopic(node, self._pose_type, f"{service_name}/pose", self._publish_pose),
        )

    def close(self) -> None:
        """Stop publishing and destroy the publishers."""
        for topic in self._topics:
            topic.close()

    async def _publish_events(self, publisher: Publisher[TaskEvents]) -> None:
        feed, running = self._manager.change_feed, self._manager.running
        revision = feed.revision
        publisher.publish(self._events([] if running is None else [running.task_id], revision))
        while not feed.is_closed:
            await feed.wait_for_change(revision, _NO_TIMEOUT)
            await asyncio.sleep(EVENT_PERIOD)
            changed, revision = feed.changed_since(revision), feed.revision
            publisher.publish(self._events(changed, revision))

    def _events(self, changed: list[int] | None, revision: int) -> TaskEvents:
        manager = self._manager
        complete = changed is not None and len(changed) <= MOST_TASKS
        manager.update_estimates()
        found = [manager.repository.find(task_id) for task_id in changed or () if complete]
        return self._events_type(
            revision=revision,
            complete=complete,
            paused=manager.is_paused,
            queued=len(manager.queue),
            running=0 if manager.running is None else manager.running.task_id,
            tasks=[
                self._messages.task_info(
                    task,
                    manager.estimate(task.task_id),
                    manager.planned_robot(task),
                    manager.waits_for(task),
                )
                for task in found
                if task is not None
            ],
        )

    async def _publish_pose(self, publisher: Publisher[PoseStamped]) -> None:
        feed, last = self._manager.change_feed, None
        while not feed.is_closed:
            pose, revision = self._manager.pose(), feed.revision
            if pose != last:
                publisher.publish(self._stamped(pose))
            elif self._manager.running is None:  # the robot moves again only with a task
                await feed.wait_for_change(revision, _NO_TIMEOUT)
            last = pose
            await asyncio.sleep(POSE_PERIOD)

    def _stamped(self, pose: Pose) -> PoseStamped:
        message = self._pose_type()
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(time_of_day_ns(), 10**9)
        message.header.frame_id = _FRAME
        message.pose.position.x, message.pose.position.y = pose.x, pose.y
        message.pose.orientation.z = math.sin(pose.theta / 2)
        message.pose.orientation.w = math.cos(pose.theta / 2)
        return message


class _OnDemandTopic(Generic[MsgT]):
    """A publisher, and an asyncio task that publishes while the topic has subscribers."""

    def __init__(
        self,
        node: Node,
        msg_type: type[MsgT],
        topic: str,
        publish: Callable[[Publisher[MsgT]], Coroutine[Any, Any, None]],
    ) -> None:
        self._publish = publish
        self._task: asyncio.Task[None] | None = None
        self._publisher = node.create_publisher(msg_type, topic, _LATEST)
        self._publisher.on_matched = self._subscriptions_changed

    def close(self) -> None:
        """Stop publishing and destroy the publisher."""
        self._stop()
        self._publisher.destroy()

    def _subscriptions_changed(self) -> None:
        if not self._publisher.get_subscription_count():
            self._stop()
        elif self._task is None:
            # The latched message is from before the last subscriber left: it is out of date.
            self._publisher.forget_latched()
            self._task = asyncio.get_running_loop().create_task(self._publish(self._publisher))

    def _stop(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._publisher.forget_latched()
