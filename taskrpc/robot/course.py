"""The simulated robot's state over time: standing, or on a stretch that began at an instant.

Nothing ticks. Pose, time left and battery follow from the instant at which a stretch (a motion,
then some work where it ends) began. A halt settles the stretch: what is behind goes into the
standing state, what is ahead becomes a new stretch from rest. `now` is in robot seconds, on any
clock.
"""

import math

import msgspec

from taskrpc.robot import battery
from taskrpc.robot.kinematics import Limits, Motion, Point
from taskrpc.robot.protocol import Pose

_AT_DOCK = 0.1  # metres


class Standing(msgspec.Struct, frozen=True):
    """The robot at rest."""

    pose: Pose
    odometer: float
    """Metres driven ever."""
    battery: float
    """Percent."""
    since: float | None
    """An instant; None when no clock is known yet."""


class Course:
    """Where the robot stands, and the stretch of the task that lies ahead of it, if any.

    Attributes:
        standing: the state at the last halt.
        began: when the robot set out on the stretch; None while it is halted.
        spent: robot seconds of the task that are behind the last halt.
    """

    def __init__(self, pose: Pose, dock: Point, limits: Limits) -> None:
        self.standing = Standing(pose, 0.0, battery.FULL, None)
        self.began: float | None = None
        self.spent = 0.0
        self._dock = dock
        self._limits = limits
        self.clear()

    def assign(self, motion: Motion, work: float) -> None:
        """Put a task ahead of the halted robot: a motion from where it stands, then `work`."""
        self._motion, self._work, self.spent = motion, work, 0.0

    def clear(self) -> None:
        """Forget what lies ahead of the halted robot."""
        self.assign(Motion(self.standing.pose, (), self._limits), 0.0)

    def forget_clock(self) -> None:
        """From now on, instants are on another clock; for a halted robot only."""
        self.standing = msgspec.structs.replace(self.standing, since=None)

    def go(self, now: float) -> None:
        """Set out on what lies ahead."""
        standing = self.standing
        rested = 0.0 if standing.since is None else now - standing.since
        charge = self._charge_after_rest(standing.battery, standing.pose, rested)
        self.standing = msgspec.structs.replace(standing, battery=charge, since=now)
        self.began = now

    def halt(self, now: float) -> None:
        """Stand still; what is left lies ahead, to be driven from rest."""
        if self.began is not None:
            self._settle(self.began, self._elapsed(now))

    def complete(self) -> None:
        """Arrive: everything that lay ahead is behind, to the last bit, at `end`."""
        if self.began is not None:
            self._settle(self.began, self._duration())

    def end(self) -> float:
        """The instant at which nothing is left; inf while the robot is halted."""
        return math.inf if self.began is None else self.began + self._duration()

    def pose(self, now: float) -> Pose:
        """Where the robot is."""
        if self.began is None:
            return self.standing.pose
        return self._motion.pose_at(self._elapsed(now))

    def remaining(self, now: float) -> float:
        """Robot seconds that lie ahead."""
        return self._duration() - self._elapsed(now)

    def progress(self, now: float) -> float:
        """The share of the task's time that is behind; 1.0 where nothing lies ahead."""
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
        before, motion = self.standing, self._motion
        pose, metres = motion.pose_at(elapsed), motion.distance_at(elapsed)
        driving = min(elapsed, motion.duration)
        working = elapsed - driving
        charge = battery.driven(before.battery, driving, metres)
        charge = self._charge_after_rest(charge, pose, working)
        self.standing = Standing(pose, before.odometer + metres, charge, began + elapsed)
        self.began = None
        self.spent += elapsed
        self._work = max(0.0, self._work - working)
        self._motion = Motion(pose, motion.waypoints_after(elapsed), self._limits)

    def _charge_after_rest(self, charge: float, pose: Pose, seconds: float) -> float:
        docked = math.dist((pose.x, pose.y), self._dock) <= _AT_DOCK
        return battery.stood(charge, seconds, docked=docked)
