"""A buffer in another process, asked by the action `tf2_msgs/action/LookupTransform`."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import tf2_py
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.time import Time
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error

from .buffer_interface import BufferInterface

if TYPE_CHECKING:
    from rclpy.node import Node

_ERRORS = {
    TF2Error.LOOKUP_ERROR: tf2_py.LookupException,
    TF2Error.CONNECTIVITY_ERROR: tf2_py.ConnectivityException,
    TF2Error.EXTRAPOLATION_ERROR: tf2_py.ExtrapolationException,
    TF2Error.INVALID_ARGUMENT_ERROR: tf2_py.InvalidArgumentException,
    TF2Error.TIMEOUT_ERROR: tf2_py.TimeoutException,
}


class BufferClient(BufferInterface):
    """Looks transforms up in the buffer of a server; another thread must spin the node.

    Args:
        node: the node of the action client.
        ns: the name of the server's action.
        check_frequency: has no effect, because the client does not poll.
        timeout_padding: how much longer than its own timeout a lookup may take.
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float = 10.0,
        timeout_padding: Duration = Duration(seconds=2.0),  # noqa: B008
    ) -> None:
        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, LookupTransform, action_name=ns)
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """As `Buffer.lookup_transform`. Also raises TimeoutException if the server is silent."""
        return self._ask(
            LookupTransform.Goal(
                target_frame=target_frame,
                source_frame=source_frame,
                source_time=_message_of(time),
                timeout=timeout.to_msg(),
            )
        )

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """As `Buffer.lookup_transform_full`. Also raises TimeoutException."""
        return self._ask(
            LookupTransform.Goal(
                target_frame=target_frame,
                target_time=_message_of(target_time),
                source_frame=source_frame,
                source_time=_message_of(source_time),
                fixed_frame=fixed_frame,
                timeout=timeout.to_msg(),
                advanced=True,
            )
        )

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> bool:
        """Whether `lookup_transform` finds the transform."""
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except tf2_py.TransformException:
            return False
        return True

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> bool:
        """Whether `lookup_transform_full` finds the transform."""
        try:
            self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        except tf2_py.TransformException:
            return False
        return True

    def _ask(self, goal: Any) -> Any:
        if not self.action_client.server_is_ready():
            raise tf2_py.TimeoutException("The BufferServer is not ready.")
        patience = Duration.from_msg(goal.timeout) + self.timeout_padding
        seconds = patience.nanoseconds / 1e9
        handle = self._result_of(self.action_client.send_goal_async(goal), seconds)
        if not handle.accepted:
            raise tf2_py.TimeoutException(
                "The LookupTransform goal sent to the BufferServer did not come back with accepted"
                " status. Something is likely wrong with the server."
            )
        result = self._result_of(handle.get_result_async(), seconds).result
        if result.error.error != TF2Error.NO_ERRORS:
            kind = _ERRORS.get(result.error.error, tf2_py.TransformException)
            raise kind(result.error.error_string)
        return result.transform

    def _result_of(self, future: Any, seconds: float) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        if not done.wait(seconds):
            raise tf2_py.TimeoutException(
                "The LookupTransform goal sent to the BufferServer did not come back in the"
                " specified time. Something is likely wrong with the server."
            )
        return future.result()


def _message_of(time: Any) -> Any:
    return time.to_msg() if hasattr(time, "to_msg") else time
