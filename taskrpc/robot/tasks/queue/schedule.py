"""The queued tasks as one schedule: each plan starts at the pose where the plan before it ends.

The tasks of one priority form a level, sorted by arrival and weighed by their planned seconds. The
seconds ahead of a task are therefore a sum over whole levels and a part of one level. A task that
leaves from the middle changes only the plans that follow it directly, not all plans.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import NamedTuple, TypeAlias

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import LEVELS, RUNNING_KEY, OrderKey, Task
from taskrpc.robot.tasks.queue.sum_tree import SumTree

Planner: TypeAlias = Callable[[Task, Pose], Plan]
"""Plans a task from a pose: its duration and the pose where it ends. Must not raise."""


class Shift(NamedTuple):
    """All tasks behind a place in the order end later by some seconds."""

    after: OrderKey
    """The tasks with a greater key are shifted."""
    seconds: float
    """Robot seconds; negative: they end earlier."""


class _PlannedTask:
    """A queued task with its plan."""

    __slots__ = ("key", "plan", "start", "task")

    def __init__(self, task: Task, key: OrderKey, start: Pose, plan: Plan) -> None:
        self.task = task
        self.key = key
        self.start = start  # the pose that `plan` was made for
        self.plan = plan


class Schedule:
    """The queued tasks in the order of execution, with a plan for each.

    Args:
        plan: see `Planner`.
        start_pose: where the robot will be when the first queued task begins.
    """

    def __init__(self, plan: Planner, start_pose: Pose) -> None:
        self._plan = plan
        self._start_pose = start_pose
        self._levels: dict[int, SumTree[_PlannedTask]] = {level: SumTree() for level in LEVELS}
        self._planned: dict[int, _PlannedTask] = {}  # by task_id

    def insert(self, task: Task) -> list[Shift]:
        """Add a task at its place; returns the shifts of the tasks behind it."""
        level, arrival = key = task.order_key
        before = self._before(level, arrival)
        start = before.plan.end if before else self._start_pose
        added = _PlannedTask(task, key, start, self._plan(task, start))
        self._levels[level].insert(arrival, added, added.plan.seconds)
        self._planned[task.task_id] = added
        return self._shifts(key, added.plan.seconds, added)

    def replace(self, task: Task) -> None:
        """Replace a scheduled task by a newer value that has the same place and plan."""
        self._planned[task.task_id].task = task

    def remove(self, task: Task) -> list[Shift]:
        """Take a task out; returns the shifts of the tasks behind it."""
        removed = self._planned.pop(task.task_id)
        level, arrival = removed.key
        self._levels[level].remove(arrival)
        return self._shifts(removed.key, -removed.plan.seconds, self._before(level, arrival))

    def take_first(self) -> Plan:
        """Take the first task out because its execution begins; returns its plan.

        No task is shifted: the seconds of this task are still ahead of all others.
        """
        first = next(self._planned_after(RUNNING_KEY))
        level, arrival = first.key
        self._levels[level].remove(arrival)
        del self._planned[first.task.task_id]
        self._start_pose = first.plan.end
        return first.plan

    def set_start_pose(self, pose: Pose) -> list[Shift]:
        """Set where the robot will be when the first task begins; returns the shifts."""
        if pose == self._start_pose:
            return []
        self._start_pose = pose
        return list(self._plan_again(self._planned_after(RUNNING_KEY), None))

    def seconds_through(self, task: Task) -> float:
        """Return the robot seconds from the start of the first task to the end of this one."""
        own_level, arrival = self._planned[task.task_id].key
        ahead = 0.0
        for level, tasks in self._levels.items():
            if level >= own_level:
                break
            ahead += tasks.weight
        return ahead + self._levels[own_level].weight_through(arrival)

    def seconds_with(self, task: Task) -> float:
        """Return what `seconds_through` would return if this task were inserted."""
        level, arrival = task.order_key
        before = self._before(level, arrival)
        start = before.plan.end if before else self._start_pose
        ahead = self.seconds_through(before.task) if before else 0.0
        return ahead + self._plan(task, start).seconds

    def tasks_after(self, key: OrderKey = RUNNING_KEY) -> Iterator[tuple[Task, float]]:
        """Iterate over the tasks behind a place, each with its `seconds_through`."""
        own_level, arrival = key
        seconds = 0.0
        for level, tasks in self._levels.items():
            if level < own_level:
                seconds += tasks.weight
            elif level == own_level:
                seconds += tasks.weight_through(arrival)
        for planned in self._planned_after(key):
            seconds += planned.plan.seconds
            yield planned.task, seconds

    def _before(self, level: int, arrival: int) -> _PlannedTask | None:
        """Return the task directly before a place, None if that place is the first."""
        if before := self._levels[level].before(arrival):
            return before
        earlier = range(level - 1, LEVELS[0] - 1, -1)  # the nearest first
        return next((self._levels[each].last() for each in earlier if self._levels[each]), None)

    def _planned_after(self, key: OrderKey) -> Iterator[_PlannedTask]:
        own_level, arrival = key
        for level, tasks in self._levels.items():
            if level >= own_level and tasks:
                yield from tasks.behind(arrival if level == own_level else -math.inf)

    def _shifts(self, key: OrderKey, seconds: float, before: _PlannedTask | None) -> list[Shift]:
        """Return the shifts behind a place where a task came or went.

        `before` is the task that now precedes the tasks behind that place.
        """
        behind = self._planned_after(key)
        if (first := next(behind, None)) is None:
            return []
        return [Shift(key, seconds), *self._plan_again(chain((first,), behind), before)]

    def _plan_again(
        self, behind: Iterable[_PlannedTask], before: _PlannedTask | None
    ) -> Iterator[Shift]:
        """Plan tasks again, up to the first task that starts where it started before."""
        for planned in behind:
            start = before.plan.end if before else self._start_pose
            if planned.start == start:
                return
            old_seconds = planned.plan.seconds
            planned.start, planned.plan = start, self._plan(planned.task, start)
            level, arrival = planned.key
            self._levels[level].weigh(arrival, planned.plan.seconds)
            after = before.key if before else RUNNING_KEY
            yield Shift(after, planned.plan.seconds - old_seconds)
            before = planned
