"""A buffer that programs on other machines ask with a BufferClient.

`taskrpc run tf2_ros buffer_server` serves the transforms of `/tf` and `/tf_static`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import rclpy
import tf2_py
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error

from .buffer import Buffer
from .transform_listener import TransformListener

_Goal: TypeAlias = ServerGoalHandle[
    LookupTransform.Goal, LookupTransform.Result, LookupTransform.Feedback
]

_CODES = {
    tf2_py.LookupException: TF2Error.LOOKUP_ERROR,
    tf2_py.ConnectivityException: TF2Error.CONNECTIVITY_ERROR,
    tf2_py.ExtrapolationException: TF2Error.EXTRAPOLATION_ERROR,
    tf2_py.InvalidArgumentException: TF2Error.INVALID_ARGUMENT_ERROR,
    tf2_py.TimeoutException: TF2Error.TIMEOUT_ERROR,
}


class BufferServer:
    """Answers goals of the action `tf2_msgs/action/LookupTransform`, as ROS's C++ class does.

    Args:
        buffer: the transforms.
        node: the node of the action server.
        ns: the name of the action.
        check_period: the time between two looks for a transform that is not there yet.
    """

    def __init__(
        self,
        buffer: Buffer,
        node: Node,
        ns: str,
        check_period: Duration = Duration(seconds=0.01),  # noqa: B008
    ) -> None:
        self.buffer = buffer
        self.node = node
        self._period = check_period.nanoseconds / 1e9
        self._server = ActionServer(
            node,
            LookupTransform,
            ns,
            self._execute,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def destroy(self) -> None:
        """Remove the action from the node."""
        self._server.destroy()

    async def _execute(self, goal: _Goal) -> LookupTransform.Result:
        await self._until_found(goal)
        result = LookupTransform.Result()
        if goal.is_cancel_requested:
            goal.canceled()
            return result
        try:
            result.transform = self._lookup(goal.request)
        except tf2_py.TransformException as error:
            result.error.error = _CODES.get(type(error), TF2Error.TRANSFORM_ERROR)
            result.error.error_string = str(error)
        goal.succeed()
        return result

    async def _until_found(self, goal: _Goal) -> None:
        """Wait until the transform is there, or the goal's timeout ends, or it is cancelled."""
        clock = self.node.get_clock()
        end = clock.now() + Duration.from_msg(goal.request.timeout)
        ended: Future[None] = Future()

        def look() -> None:
            is_over = goal.is_cancel_requested or clock.now() >= end
            if not ended.done() and (is_over or self._has(goal.request)):
                ended.set_result(None)

        look()
        timer = self.node.create_timer(self._period, look)
        await ended
        self.node.destroy_timer(timer)

    def _has(self, request: LookupTransform.Goal) -> bool:
        try:
            self._lookup(request)
        except tf2_py.TransformException:
            return False
        return True

    def _lookup(self, request: LookupTransform.Goal) -> TransformStamped:
        """The transform of a request. Raises TransformException."""
        target, source = request.target_frame, request.source_frame
        time = Time.from_msg(request.source_time)
        if not request.advanced:
            return self.buffer.lookup_transform(target, source, time)
        return self.buffer.lookup_transform_full(
            target, Time.from_msg(request.target_time), source, time, request.fixed_frame
        )


def main(args: Sequence[str] | None = None) -> int:
    """Serve transforms until Ctrl-C."""
    try:
        with rclpy.init(args=args):
            node = Node("tf_buffer")
            size = node.declare_parameter("buffer_size", 120.0).value
            buffer = Buffer(Duration(seconds=size), node)
            listener = TransformListener(buffer, node)
            BufferServer(buffer, node, "tf2_buffer_server")
            rclpy.spin(node)
            listener.unregister()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0
