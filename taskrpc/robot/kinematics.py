"""Motion in closed form: where the robot is at any time of a drive, and how long the drive takes.

A differential drive turns on the spot to the heading of the next leg, drives the leg, and stops at
its end. Turning and driving both follow a trapezoid: accelerate, cruise, brake. Nothing is
simulated step by step, so a plan and its execution agree exactly.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

import msgspec

from taskrpc.robot.protocol import Pose

Point = tuple[float, float]
"""(x, y) in metres."""

_SAME_PLACE = 1e-6  # metres; a shorter leg has no meaningful direction
_SAME_HEADING = 1e-9  # radians


class Limits(msgspec.Struct, frozen=True):
    """The robot's maximum speeds and accelerations."""

    speed: float = 1.5
    """Metres per second."""
    acceleration: float = 1.2
    """Metres per second squared, also for braking."""
    turn_speed: float = 3.0
    """Radians per second."""
    turn_acceleration: float = 6.0
    """Radians per second squared, also for braking."""


class Trapezoid:
    """A movement of `length` from rest to rest: accelerate, cruise at up to `speed`, brake."""

    __slots__ = ("_acceleration", "_peak", "_ramp", "duration", "length")

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self._acceleration = acceleration
        self._ramp = min(speed / acceleration, math.sqrt(length / acceleration))
        self._peak = acceleration * self._ramp
        self.length = length
        self.duration = length / self._peak + self._ramp if self._peak else 0.0

    def at(self, t: float) -> float:
        """Return the length covered after `t` seconds; times outside the movement are clipped."""
        left = self.duration - t
        if t <= 0.0:
            return 0.0
        if left <= 0.0:
            return self.length
        if t < self._ramp:
            return 0.5 * self._acceleration * t * t
        if left < self._ramp:
            return self.length - 0.5 * self._acceleration * left * left
        return self._peak * (t - 0.5 * self._ramp)


class Leg:
    """A turn on the spot and then a straight drive; it begins and ends at rest."""

    __slots__ = ("_angle", "_drive", "_start", "_turn", "duration", "end", "length")

    def __init__(self, start: Pose, goal: Point, limits: Limits) -> None:
        dx, dy = goal[0] - start.x, goal[1] - start.y
        heading = math.atan2(dy, dx)
        angle = normalised(heading - start.theta)
        self._start = start
        self._angle = angle if abs(angle) > _SAME_HEADING else 0.0
        self._turn = Trapezoid(abs(self._angle), limits.turn_speed, limits.turn_acceleration)
        self._drive = Trapezoid(math.hypot(dx, dy), limits.speed, limits.acceleration)
        self.length = self._drive.length
        self.duration = self._turn.duration + self._drive.duration
        self.end = Pose(goal[0], goal[1], normalised(heading))

    def distance_at(self, t: float) -> float:
        """Return the metres driven after `t` seconds."""
        return self._drive.at(t - self._turn.duration)

    def pose_at(self, t: float) -> Pose:
        """Return the pose after `t` seconds."""
        start, end = self._start, self.end
        if t >= self.duration:
            return end
        if t < self._turn.duration:
            turned = math.copysign(self._turn.at(t), self._angle)
            return Pose(start.x, start.y, normalised(start.theta + turned))
        share = self.distance_at(t) / self.length
        x, y = start.x + share * (end.x - start.x), start.y + share * (end.y - start.y)
        return Pose(x, y, end.theta)


class Motion:
    """A drive from `start` through `waypoints`, one leg after the other.

    A waypoint at the robot's own position is skipped, so a motion to it takes 0.0 seconds and
    keeps the heading.

    Attributes:
        duration: seconds until the robot stands at the last waypoint.
        distance: metres driven by then.
        end: the pose by then.
    """

    __slots__ = ("_from", "_legs", "_starts", "distance", "duration", "end")

    def __init__(self, start: Pose, waypoints: Sequence[Point], limits: Limits) -> None:
        self._legs: list[Leg] = []
        self._from = start.x, start.y
        self.end = start
        for point in waypoints:
            if math.dist(point, (self.end.x, self.end.y)) > _SAME_PLACE:
                self._legs.append(Leg(self.end, point, limits))
                self.end = self._legs[-1].end
        *self._starts, self.duration = accumulate((g.duration for g in self._legs), initial=0.0)
        self.distance = math.fsum(leg.length for leg in self._legs)

    def pose_at(self, t: float) -> Pose:
        """Return the pose `t` seconds after the start; times outside are clipped."""
        if t >= self.duration:
            return self.end
        leg = self._leg_at(t)
        return self._legs[leg].pose_at(t - self._starts[leg])

    def distance_at(self, t: float) -> float:
        """Return the metres driven `t` seconds after the start; turning adds none."""
        if t >= self.duration:
            return self.distance
        leg = self._leg_at(t)
        behind = math.fsum(done.length for done in self._legs[:leg])
        return behind + self._legs[leg].distance_at(t - self._starts[leg])

    def path(self) -> list[Point]:
        """Return the start and all waypoints; nothing if the motion has no leg."""
        ends = [(leg.end.x, leg.end.y) for leg in self._legs]
        return [self._from, *ends] if ends else []

    def waypoints_after(self, t: float) -> list[Point]:
        """Return the waypoints that are not reached after `t` seconds."""
        if t >= self.duration:
            return []
        return [(leg.end.x, leg.end.y) for leg in self._legs[self._leg_at(t) :]]

    def _leg_at(self, t: float) -> int:
        return max(0, bisect_right(self._starts, t) - 1)


def normalised(angle: float) -> float:
    """Return the same angle in (-pi, pi]."""
    # remainder() returns -pi for odd multiples of pi that round down.
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped
