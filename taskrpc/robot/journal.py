"""A journal of the simulated robot: every step of its motion, for recordings.

A step can be repeated: the same inputs give the same motion, because `Course` is pure. Without a
journal, none of this runs.
"""

from collections.abc import Callable
from typing import TypeAlias

import msgspec

from taskrpc.robot.course import Course, Standing
from taskrpc.robot.kinematics import Limits, Motion, Point
from taskrpc.robot.obstacles import Box
from taskrpc.robot.protocol import Pose
from taskrpc.robot.world import DOCK, World


class WorldFacts(msgspec.Struct, frozen=True):
    """A map as plain values."""

    size: Point
    dock: Point
    radius: float
    """The robot's radius, in metres."""
    boxes: tuple[Box, ...]
    """The obstacles."""
    places: dict[str, Point]
    """The named places, without the dock."""

    @classmethod
    def of(cls, world: World) -> "WorldFacts":
        """Return the facts of a map."""
        places = {name: point for name, point in world.places.items() if name != DOCK}
        return cls(world.size, world.dock, world.robot_radius, world.obstacles, places)

    def world(self) -> World:
        """Return an equal map."""
        return World(
            self.size,
            dock=self.dock,
            obstacles=self.boxes,
            places=self.places,
            robot_radius=self.radius,
        )


class RobotStart(msgspec.Struct, frozen=True, tag_field="op", tag="robot_start"):
    """The robot and its map before the first task."""

    standing: Standing
    limits: Limits
    world: WorldFacts


class RobotStep(
    msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="op", tag="robot"
):
    """One call of a method of `Course`: first its inputs, then what follows from them."""

    method: str
    now: float = 0.0
    """The robot's clock."""
    waypoints: tuple[Point, ...] = ()
    """The corners of the path, without the start."""
    work: float = 0.0
    """Robot seconds of work after the drive."""

    duration: float = 0.0
    """Robot seconds that the drive takes."""
    standing: Standing | None = None
    """The robot at rest; None while it moves."""
    end: float | None = None
    """When the task will be complete; None while the robot is halted."""


RobotJournal: TypeAlias = Callable[[RobotStart | RobotStep], object]
"""Takes each step; it must be quick and must not raise."""


class JournaledCourse(Course):
    """A course that writes a journal; its motion is that of any other."""

    _journal: RobotJournal | None = None
    """None until the course is complete: `Course.__init__` calls `assign`."""

    def __init__(
        self, pose: Pose, dock: Point, limits: Limits, world: World, journal: RobotJournal
    ) -> None:
        super().__init__(pose, dock, limits)
        journal(RobotStart(self.standing, limits, WorldFacts.of(world)))
        self._journal = journal

    def assign(self, motion: Motion, work: float) -> None:
        """Give the halted robot a task; see `Course`."""
        super().assign(motion, work)
        if self._journal is not None:
            waypoints = tuple(motion.waypoints_after(0.0))
            self._write(
                RobotStep(method="assign", waypoints=waypoints, work=work, duration=motion.duration)
            )

    def forget_clock(self) -> None:
        """Prepare for another clock; see `Course`."""
        super().forget_clock()
        self._write(RobotStep(method="forget_clock"))

    def go(self, now: float) -> None:
        """Set out on the task; see `Course`."""
        super().go(now)
        self._write(RobotStep(method="go", now=now))

    def halt(self, now: float) -> None:
        """Halt; see `Course`."""
        was_moving = self.began is not None
        super().halt(now)
        if was_moving:
            self._write(RobotStep(method="halt", now=now))

    def complete(self) -> None:
        """Complete the task; see `Course`."""
        super().complete()
        self._write(RobotStep(method="complete"))

    def _write(self, step: RobotStep) -> None:
        if self._journal is None:
            return
        if self.began is None:
            step = msgspec.structs.replace(step, standing=self.standing)
        else:
            step = msgspec.structs.replace(step, end=self.end())
        self._journal(step)
