"""The velocities that draw a square: ahead, stop, turn, stop, and again. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from taskrpc.ros.turtlesim.world import normalized

_LENGTH = 2.0
_SPEED, _TURNING = 1.0, 0.4
_NEAR, _ALIGNED, _STILL = 0.1, 0.01, 0.0001

Position = tuple[float, float, float]


@dataclass(frozen=True)
class Command:
    """What to do at one pose: velocities, and lines for the log."""

    linear: float = 0.0
    angular: float = 0.0
    log: list[str] = field(default_factory=list)


class SquareDriver:
    """Computes the next velocities from each pose of the turtle."""

    def __init__(self) -> None:
        self._goal: Position | None = None
        self._turns = False
        self._stops = False

    def command(self, pose: Position, moves: bool) -> Command:
        """The next command.

        Args:
            pose: x, y and heading of the turtle.
            moves: whether its velocity is not yet zero.
        """
        if self._goal is None:
            return Command(log=[self._aim(pose)])
        if not self._stops:
            self._stops = _reached(pose, self._goal)
        if self._stops:
            if moves:
                return Command()
            self._stops, self._turns = False, not self._turns
            return Command(log=["Reached goal", self._aim(pose)])
        return Command(angular=_TURNING) if self._turns else Command(linear=_SPEED)

    def _aim(self, pose: Position) -> str:
        x, y, theta = pose
        if self._turns:
            self._goal = x, y, normalized(theta + math.pi / 2)
        else:
            self._goal = x + math.cos(theta) * _LENGTH, y + math.sin(theta) * _LENGTH, theta
        return "New goal [{:f} {:f}, {:f}]".format(*self._goal)


def is_moving(linear: float, angular: float) -> bool:
    """Whether a turtle with these velocities still moves."""
    return abs(linear) >= _STILL or abs(angular) >= _STILL


def _reached(pose: Position, goal: Position) -> bool:
    near = math.dist(pose[:2], goal[:2]) < _NEAR
    return near and abs(normalized(pose[2] - goal[2])) < _ALIGNED
