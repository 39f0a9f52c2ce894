"""The plan of a fleet: in order of execution, each task goes to the robot that completes it first.

All servers compute the same plan from the same records. A server begins only the task that the plan
gives to its own robot next. The plan is pure: time and records are arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

from taskrpc.robot.fleet.model import Abilities, RobotRecord
from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import Task

HORIZON = 500
"""How many tasks are planned one by one; estimates of later tasks continue the trend."""
PATIENCE = 2.0
"""Seconds in which a free robot must begin its task before another robot may take it.

Two servers may compute different plans, because only a robot's own server knows its drives exactly.
A robot whose server does not begin the task that others expect it to is left out of their plans.
"""

Planner: TypeAlias = Callable[[RobotRecord, str, str, Pose], Plan | None]
"""Returns a robot's plan of a task type and target from a pose; None if it cannot execute it."""


class Planned(NamedTuple):
    """The place of one task in the plan."""

    task_id: int
    robot: str
    begins: float
    """When the robot begins it, in seconds since 1970."""
    ends: float


class FleetPlan:
    """The plan of the first tasks, computed as far as it is asked for.

    It stays valid while tasks are only added behind all others.

    Args:
        task_at: returns the queued task at a place in the order of execution, from 0; None behind
            the last one.
        robots: the robots with a lease.
        abilities: which robot can execute which task.
        now: seconds since 1970, by the database.
        planner: see `Planner`.
        own: the robot of the server that computes the plan; `PATIENCE` does not concern it.
    """

    def __init__(
        self,
        task_at: Callable[[int], Task | None],
        robots: Sequence[RobotRecord],
        abilities: Abilities,
        now: float,
        planner: Planner,
        own: str = "",
    ) -> None:
        self.made_at = now
        self.robots = robots
        """The robots that the plan counts on."""
        self._task_at = task_at
        self._abilities = abilities
        self._planner = planner
        self._free = {robot.name: (_free_at(robot, now), robot.pose) for robot in robots}
        self._slow = {
            robot.name
            for robot in robots
            if robot.name != own and not robot.task_id and now - robot.free_at > PATIENCE
        }
        """Robots that have been free for so long that they should have begun an old task."""
        self._seen = 0
        """How many tasks the plan has looked at."""
        self._planned: dict[int, Planned] = {}

    def find(self, task_id: int) -> Planned | None:
        """Return the place of a task, None if no robot can execute it or it is not planned."""
        while task_id not in self._planned and (task := self._next()) is not None:
            if task.task_id == task_id:
                break
        return self._planned.get(task_id)

    def first_of(self, robot: str) -> Planned | None:
        """Return the first task of a robot, None if it has none within the horizon."""
        for known in self._planned.values():
            if known.robot == robot:
                return known
        while (task := self._next()) is not None:
            planned = self._planned.get(task.task_id)
            if planned is not None and planned.robot == robot:
                return planned
        return None

    def free_at(self) -> float:
        """Return when the first robot has ended all its planned tasks, at least now."""
        while self._next() is not None:
            pass
        return min((free for free, _ in self._free.values()), default=self.made_at)

    def seconds_for_each(self) -> float:
        """Return the seconds by which one more task delays the tasks far behind the plan."""
        count = len(self._planned)
        return (self.free_at() - self.made_at) / count if count else 0.0

    def _next(self) -> Task | None:
        """Plan one more task; returns it, None if there is none within the horizon."""
        if self._seen >= HORIZON or (task := self._task_at(self._seen)) is None:
            return None
        self._seen += 1
        best = self._best(task)
        if best is not None:
            planned, pose = best
            self._free[planned.robot] = planned.ends, pose
            self._planned[task.task_id] = planned
        return task

    def _best(self, task: Task) -> tuple[Planned, Pose] | None:
        able = self._abilities.of(task.task_type, task.target)
        is_old = self.made_at - task.submitted_at > PATIENCE
        best: tuple[Planned, Pose] | None = None
        first = math.inf  # the earliest end so far
        for robot in self.robots:
            name = robot.name
            begins, pose = self._free[name]
            if begins >= first or name not in able or (is_old and name in self._slow):
                continue
            plan = self._planner(robot, task.task_type, task.target, pose)
            if plan is None:
                continue
            ends = begins + plan.seconds / robot.speed
            if ends < first:
                first = ends
                best = Planned(task.task_id, name, begins, ends), plan.end
        return best


def _free_at(robot: RobotRecord, now: float) -> float:
    """Return when a robot is expected to be free."""
    if not robot.task_id:
        return now
    # A robot that is late is expected to be late by as much again.
    return robot.free_at + 2.0 * max(0.0, now - robot.free_at)
