"""The robot: the Protocol for one's own hardware, and a kinematic stub that drives on a map."""

from taskrpc.robot.document import MapError
from taskrpc.robot.driver import KinematicRobot
from taskrpc.robot.kinematics import Limits
from taskrpc.robot.mapfile import default_world, parse_map, read_map
from taskrpc.robot.obstacles import Box
from taskrpc.robot.protocol import Plan, Pose, Robot, RobotStopped, TargetError
from taskrpc.robot.world import World

__all__ = [
    "Box",
    "KinematicRobot",
    "Limits",
    "MapError",
    "Plan",
    "Pose",
    "Robot",
    "RobotStopped",
    "TargetError",
    "World",
    "default_world",
    "parse_map",
    "read_map",
]
