"""The simulated robot's state over time: at rest, or driving since an instant.

Nothing is simulated step by step. Pose, remaining time and battery are computed from the instant
at which the robot set out on its motion and the work at its end. A halt moves the completed part
into the state at rest; the rest of the task becomes a new motion. `now` is in robot seconds, on
any clock.
"""

import math

import msgspec

from taskrpc.robot.kinematics import Limits, Motion, Point
from taskrpc.robot.protocol import Pose

BATTERY_FULL = 100.0
"""Percent."""

_AT_DOCK = 0.1  # metres
# Battery, in percent. It is telemetry only and never stops the robot.
_BATTERY_FLOOR = 5.0  # an empty battery would end a long demonstration
_DRAIN_PER_METRE = 0.2
_DRAIN_PER_SECOND = 0.01  # the computer and the sensors
_CHARGE_PER_SECOND = 0.5


class Standing(msgspec.Struct, frozen=True):
    """The robot at rest."""

    pose: Pose
    odometer: float
    """Metres driven since the start."""
    battery: float
    """Percent."""
    since: float | None
    """The instant of the halt; None before the robot knows a clock."""


class Course:
    """The robot's state at rest, and the part of a task that is ahead of it."""

    def __init__(self, pose: Pose, dock: Point, limits: Limits) -> None:
        self.standing = Standing(pose, 0.0, BATTERY_FULL, None)
        """The state at the last halt."""
        self.began: float | None = None
        """When the robot set out; None while it is halted."""
        self.spent = 0.0
        """Robot seconds of the task before the last halt."""
        self._dock = dock
        self._limits = limits
        self.clear()

    def assign(self, motion: Motion, work: float) -> None:
        """Give the halted robot a task: a motion from its pose, then `work` robot seconds."""
        self._motion, self._work, self.spent = motion, work, 0.0

    def clear(self) -> None:
        """Take the task from the halted robot."""
        self.assign(Motion(self.standing.pose, (), self._limits), 0.0)

    def forget_clock(self) -> None:
        """Prepare for instants on another clock; only for a halted robot."""
        self.standing = msgspec.structs.replace(self.standing, since=None)

    def go(self, now: float) -> None:
        """Set out on the task."""
        standing = self.standing
        rested = 0.0 if standing.since is None else now - standing.since
        charge = self._charge_at_rest(standing.battery, standing.pose, rested)
        self.standing = msgspec.structs.replace(standing, battery=charge, since=now)
        self.began = now

    def halt(self, now: float) -> None:
        """Halt; the rest of the task will start from rest."""
        if self.began is not None:
            self._settle(self.began, self._elapsed(now))

    def complete(self) -> None:
        """Complete the task exactly at `end`, without rounding."""
        if self.began is not None:
            self._settle(self.began, self._duration())

    def path(self) -> list[Point]:
        """Return the points of the motion, from where it began; nothing without a motion."""
        return self._motion.path()

    def level(self, now: float) -> Standing:
        """Return what the state would be if the robot halted now."""
        if self.began is not None:
            return self._settled(self.began, self._elapsed(now))
        standing = self.standing
        rested = 0.0 if standing.since is None else max(0.0, now - standing.since)
        charge = self._charge_at_rest(standing.battery, standing.pose, rested)
        return msgspec.structs.replace(standing, battery=charge)

    def end(self) -> float:
        """Return the instant at which the task is complete; inf while the robot is halted."""
        return math.inf if self.began is None else self.began + self._duration()

    def pose(self, now: float) -> Pose:
        """Return the robot's pose."""
        if self.began is None:
            return self.standing.pose
        return self._motion.pose_at(self._elapsed(now))

    def remaining(self, now: float) -> float:
        """Return the robot seconds that the task still takes."""
        return self._duration() - self._elapsed(now)

    def progress(self, now: float) -> float:
        """Return the completed part of the task's time; 1.0 without a task."""
        left = self.remaining(now)
        done = self.spent + self._elapsed(now)
        return done / (done + left) if left else 1.0

    def _duration(self) -> float:
        return self._motion.duration + self._work

    def _elapsed(self, now: float) -> float:
        if self.began is None:
            return 0.0
        return min(max(0.0, now - self.began), self._duration())

    def _settle(self, began: float, elapsed: float) -> None:
        motion = self._motion
        self.standing = self._settled(began, elapsed)
        self.began = None
        self.spent += elapsed
        self._work = max(0.0, self._work - (elapsed - min(elapsed, motion.duration)))
        self._motion = Motion(self.standing.pose, motion.waypoints_after(elapsed), self._limits)

    def _settled(self, began: float, elapsed: float) -> Standing:
        before, motion = self.standing, self._motion
        pose, metres = motion.pose_at(elapsed), motion.distance_at(elapsed)
        driving = min(elapsed, motion.duration)
        charge = _battery_after_drive(before.battery, driving, metres)
        charge = self._charge_at_rest(charge, pose, elapsed - driving)
        return Standing(pose, before.odometer + metres, charge, began + elapsed)

    def _charge_at_rest(self, charge: float, pose: Pose, seconds: float) -> float:
        docked = math.dist((pose.x, pose.y), self._dock) <= _AT_DOCK
        return _battery_after_rest(charge, seconds, docked=docked)


def _battery_after_drive(level: float, seconds: float, metres: float) -> float:
    return max(_BATTERY_FLOOR, level - _DRAIN_PER_METRE * metres - _DRAIN_PER_SECOND * seconds)


def _battery_after_rest(level: float, seconds: float, *, docked: bool) -> float:
    if docked:
        return min(BATTERY_FULL, level + _CHARGE_PER_SECOND * seconds)
    return max(_BATTERY_FLOOR, level - _DRAIN_PER_SECOND * seconds)
