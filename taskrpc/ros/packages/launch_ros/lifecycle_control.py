"""Changes the states of lifecycle nodes, and reports their changes as events of the launch.

One node of ROS in the launch does this for all lifecycle nodes. It exists as soon as the launch
file starts the first of them.
"""

from __future__ import annotations

import asyncio
import os
from typing import Any

from launch.event import Event
from launch.event_handler import BaseEventHandler
from launch.logging import get_logger
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState as ChangeStateService
from rclpy.context import Context
from rclpy.experimental import AsyncNode

from .events.lifecycle import VALID_TRANSITIONS, ChangeState, StateTransition

_NODE = "launch_ros node"
"""The key of the node in the global values of the context."""
_DEPTH = 10
_PATIENCE = 1.0
"""Seconds for which a change of state waits until the launch can receive the node's events."""
_POLL = 0.02


class LifecycleControl(BaseEventHandler):
    """Controls one lifecycle node; register it as an event handler of the context.

    Args:
        action: the action that starts the node.
        context: the state of the launch.
    """

    def __init__(self, action: Any, context: Any) -> None:
        super().__init__(matcher=self._wants)
        self._action = action
        self._context = context
        self._name = name = str(action.node_name)
        node = _node_of(context)
        self._events = node.create_subscription(
            TransitionEvent, f"{name}/transition_event", self._on_transition, _DEPTH
        )
        self._client = node.create_client(ChangeStateService, f"{name}/change_state")
        self._order = asyncio.Lock()
        """Requests are sent one after the other, in their order."""
        self._tasks: set[asyncio.Task[None]] = set()

    def _wants(self, event: Event) -> bool:
        return isinstance(event, ChangeState) and event.lifecycle_node_matcher(self._action)

    def handle(self, event: Any, context: Any) -> None:
        """Send the request to the node."""
        super().handle(event, context)
        task = asyncio.ensure_future(self._change(event.transition_id))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _on_transition(self, message: Any) -> None:
        self._context.emit_event_sync(StateTransition(action=self._action, msg=message))

    async def _change(self, transition_id: int) -> None:
        request = ChangeStateService.Request()
        request.transition.id = transition_id
        label = VALID_TRANSITIONS[transition_id]
        try:
            async with self._order:
                await self._client.wait_for_service()
                await self._wait_for_events()
                response = await self._client.call(request)
        except asyncio.CancelledError:  # the launch ends
            self._log().warning(f"the node {self._name} did not respond to {label}: shutdown")
        except Exception as error:
            self._log().error(f"cannot request {label} of the node {self._name}: {error}")
        else:
            if not response.success:
                self._log().error(
                    f"Failed to make transition '{label}' for LifecycleNode '{self._name}'"
                )

    async def _wait_for_events(self) -> None:
        """Wait until the launch receives the node's events: the request causes the first one."""
        for _ in range(int(_PATIENCE / _POLL)):
            if self._events.get_publisher_count():
                return
            await asyncio.sleep(_POLL)

    def _log(self) -> Any:
        return get_logger("launch_ros.actions.lifecycle_node")

    async def close(self) -> None:
        """Cancel the requests."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks)


def _node_of(context: Any) -> AsyncNode:
    """The node of ROS of a launch; the first call creates and runs it."""
    found: AsyncNode | None = context.global_values.get(_NODE)
    if found is not None:
        return found
    ros = Context()
    ros.init(args=[], initialize_logging=False)
    node = context.global_values[_NODE] = AsyncNode(
        f"launch_ros_{os.getpid()}",
        context=ros,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    )
    running = asyncio.ensure_future(node.run())

    async def close() -> None:
        node.destroy_node()
        await running
        ros.try_shutdown()

    context.at_end.append(close)
    return node
