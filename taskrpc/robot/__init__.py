"""The robot: the Protocol for one's own hardware, and a kinematic stub that drives on a map."""

from taskrpc.robot.protocol import Plan, Pose, Robot, RobotStopped, TargetError

__all__ = ["Plan", "Pose", "Robot", "RobotStopped", "TargetError"]
