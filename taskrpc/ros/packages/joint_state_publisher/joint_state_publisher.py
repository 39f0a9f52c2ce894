"""The node `joint_state_publisher`: the robot description in, joint states out."""

from __future__ import annotations

import argparse
import sys
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from robot_state_publisher.robot_state_publisher import read_description
from robot_state_publisher.urdf import Mimic, UrdfError, parse
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from .joints import Joints, Settings

_OF_DEPENDENT_JOINTS = ("parent", "factor", "offset")


class JointStatePublisher(Node):
    """Publishes the states of all joints that move.

    Args:
        description: the robot description; "" to wait for the topic `robot_description`.

    Raises:
        ValueError: a parameter is not valid.
    """

    def __init__(self, description: str = "") -> None:
        super().__init__(
            "joint_state_publisher", automatically_declare_parameters_from_overrides=True
        )
        rate = float(self._value("rate", 10))
        if not 0 < rate <= 1000:
            raise ValueError(f"expected a rate above 0, up to 1000, got {rate:g}")
        self._delta = float(self._value("delta", 0.0))
        self._settings = self._read_settings()
        self._joints: Joints | None = None
        if description:
            self._configure(description)
        else:
            self.get_logger().info(
                "Waiting for robot_description to be published on the robot_description topic..."
            )
            latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self.create_subscription(
                String, "robot_description", lambda message: self._configure(message.data), latched
            )
        strings = ParameterDescriptor(type=ParameterType.PARAMETER_STRING_ARRAY)
        for source in self._value("source_list", [], strings) or ():
            self.create_subscription(JointState, source, self._take, 10)
        self._states = self.create_publisher(JointState, "joint_states", 10)
        self.create_timer(1.0 / rate, self._publish)

    def _value(self, name: str, default: Any, descriptor: Any = None) -> Any:
        if not self.has_parameter(name):  # an override has declared it
            self.declare_parameter(name, default, descriptor or ParameterDescriptor())
        return self.get_parameter(name).value

    def _read_settings(self) -> Settings:
        zeros = self.get_parameters_by_prefix("zeros")
        return Settings(
            zeros={name: float(each.value) for name, each in zeros.items()},
            dependent_joints=_dependent_joints(self.get_parameters_by_prefix("dependent_joints")),
            use_mimic_tags=self._value("use_mimic_tags", True),
            use_smallest_joint_limits=self._value("use_smallest_joint_limits", True),
            publish_default_positions=self._value("publish_default_positions", True),
            publish_default_velocities=self._value("publish_default_velocities", False),
            publish_default_efforts=self._value("publish_default_efforts", False),
        )

    def _configure(self, description: str) -> None:
        """Use a robot description; an invalid one changes nothing."""
        try:
            self._joints = Joints(parse(description), self._settings)
        except UrdfError as error:
            self.get_logger().warning(f"Invalid robot_description given, ignoring: {error}")
        except ValueError as error:  # as in ROS, a chain that never ends is fatal
            self.get_logger().error(str(error))
            sys.exit(1)

    def _take(self, state: Any) -> None:
        if self._joints is not None:
            self._joints.take(state.name, state.position, state.velocity, state.effort)

    def _publish(self) -> None:
        if self._joints is None:
            return
        if self._delta > 0:
            self._joints.move(self._delta)
        states = self._joints.states()
        if not states.names:
            return
        message = JointState(
            name=states.names,
            position=states.positions,
            velocity=states.velocities,
            effort=states.efforts,
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self._states.publish(message)


def _dependent_joints(parameters: dict[str, Any]) -> dict[str, Mimic]:
    """The joints that parameters like `left_wheel.parent` name."""
    found: dict[str, dict[str, Any]] = {}
    for name, parameter in parameters.items():
        joint, _, key = name.rpartition(".")
        if not joint or key not in _OF_DEPENDENT_JOINTS:
            keys = ", ".join(_OF_DEPENDENT_JOINTS)
            raise ValueError(
                f"Invalid dependent_joint name '{name}': expected JOINT.KEY, with one"
                f" of the keys {keys}"
            )
        found.setdefault(joint, {})[key] = parameter.value
    for joint, values in found.items():
        if "parent" not in values:
            raise ValueError(
                f"All dependent_joints must at least have a parent; '{joint}' has none"
            )
    return {
        joint: Mimic(
            str(each["parent"]), float(each.get("factor", 1.0)), float(each.get("offset", 0.0))
        )
        for joint, each in found.items()
    }


def main(args: list[str] | None = None) -> None:
    """Publish until Ctrl-C; an argument is the name of a URDF file."""
    parser = argparse.ArgumentParser(prog="joint_state_publisher")
    parser.add_argument("urdf_file", help="URDF file to use", nargs="?", default="")
    file = parser.parse_args(remove_ros_args(sys.argv if args is None else args)[1:]).urdf_file
    description = read_description([file] if file else [])
    try:
        with rclpy.init(args=args):
            try:
                node = JointStatePublisher(description)
            except (ValueError, ParameterException) as error:
                sys.exit(f"joint_state_publisher cannot start: {error}")
            rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
