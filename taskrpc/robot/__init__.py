"""The robot: the Protocol for your own hardware, and a simulated robot that drives on a map.

Start reading with `protocol`. `driver` is the simulated robot, `kinematics` its motion, and `world`
and `mapfile` the map. Nothing here knows about tasks, queues or the network.
"""

from taskrpc.robot.driver import KinematicRobot
from taskrpc.robot.kinematics import Limits
from taskrpc.robot.mapfile import MapError, default_world, parse_map, read_map
from taskrpc.robot.obstacles import Box
from taskrpc.robot.protocol import Plan, Pose, Robot, RobotStopped, RobotTelemetry, TargetError
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
    "RobotTelemetry",
    "TargetError",
    "World",
    "default_world",
    "parse_map",
    "read_map",
]
