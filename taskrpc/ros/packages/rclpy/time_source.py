"""Sets a node's clocks from the `/clock` topic while its parameter `use_sim_time` is true."""

from __future__ import annotations

import contextlib
import weakref
from typing import Any

import srvgen

from ._impl.node_interface import NodeHandle, NodeInterface
from .clock import ROSClock
from .clock_type import ClockType
from .time import Time

CLOCK_TOPIC = "/clock"
"""The topic of the simulated time."""

USE_SIM_TIME_NAME = "use_sim_time"
"""The parameter that switches simulated time on."""


class TimeSource:
    """Connects clocks to the simulated time of one node; every node has its own."""

    def __init__(self, *, node: NodeInterface | None = None) -> None:
        self._clock_sub: Any = None
        self._subscribed = contextlib.ExitStack()
        """Destroys the subscription of `/clock`."""
        self._node_ref: weakref.ReferenceType[NodeInterface] | None = None
        self._associated_clocks: dict[ROSClock, None] = {}
        self._last_time_set = Time(clock_type=ClockType.ROS_TIME)
        self._ros_time_is_active = False
        if node is not None:
            self.attach_node(node)

    @property
    def ros_time_is_active(self) -> bool:
        """Whether the clocks show the time from `/clock`."""
        return self._ros_time_is_active

    @ros_time_is_active.setter
    def ros_time_is_active(self, enabled: bool) -> None:
        if self._ros_time_is_active == enabled:
            return
        self._ros_time_is_active = enabled
        for clock in self._associated_clocks:
            clock._set_ros_time_is_active(enabled)
        if enabled:
            self._subscribe_to_clock_topic()
        else:
            self._unsubscribe()

    def attach_node(self, node: NodeInterface) -> None:
        """Follow the parameter and the `/clock` of this node instead of another one."""
        from .parameter import Parameter

        if not isinstance(getattr(node, "handle", None), NodeHandle):
            raise TypeError("Node must be of type rclpy.node.Node")
        if self._node_ref is not None:
            self.detach_node()
        self._node_ref = weakref.ref(node)
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        parameter = node.get_parameter(USE_SIM_TIME_NAME)
        if parameter.type_ == Parameter.Type.BOOL:
            self.ros_time_is_active = parameter.value
        elif parameter.type_ != Parameter.Type.NOT_SET:
            node.get_logger().error(_invalid(parameter))
        node.add_on_set_parameters_callback(self._on_parameter_event)

    def detach_node(self) -> None:
        """Stop following the node."""
        self._unsubscribe()
        self._node_ref = None

    def attach_clock(self, clock: ROSClock) -> None:
        """Set this clock, too; raises ValueError unless it is a ROS clock."""
        if not isinstance(clock, ROSClock):
            raise ValueError("Only clocks with type ROS_TIME can be attached.")
        clock.set_ros_time_override(self._last_time_set)
        clock._set_ros_time_is_active(self.ros_time_is_active)
        self._associated_clocks[clock] = None

    def clock_callback(self, msg: Any) -> None:
        """Set the clocks to the time of a message from `/clock`."""
        self._last_time_set = Time.from_msg(msg.clock)
        for clock in self._associated_clocks:
            clock.set_ros_time_override(self._last_time_set)

    def _get_node(self) -> NodeInterface | None:
        return None if self._node_ref is None else self._node_ref()

    def _subscribe_to_clock_topic(self) -> None:
        from .qos import QoSProfile, ReliabilityPolicy

        node = self._get_node()
        if self._clock_sub is None and node is not None:
            self._clock_sub = node.create_subscription(
                srvgen.load("rosgraph_msgs/msg/Clock"),
                CLOCK_TOPIC,
                self.clock_callback,
                QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
            )
            self._subscribed.enter_context(self._clock_sub)

    def _unsubscribe(self) -> None:
        self._subscribed.close()
        self._clock_sub = None

    def _on_parameter_event(self, parameter_list: list[Any]) -> Any:
        """Switch simulated time when the parameter is set; reject values other than bool."""
        from .parameter import Parameter

        result = srvgen.load("rcl_interfaces/msg/SetParametersResult")
        for parameter in parameter_list:
            if parameter.name != USE_SIM_TIME_NAME:
                continue
            if parameter.type_ != Parameter.Type.BOOL:
                if (node := self._get_node()) is not None:
                    node.get_logger().error(_invalid(parameter))
                return result(successful=False, reason=_invalid(parameter))
            self.ros_time_is_active = parameter.value
        return result(successful=True)


def _invalid(parameter: Any) -> str:
    return f"Invalid type for parameter '{USE_SIM_TIME_NAME}' {parameter.type_!r} should be bool"
