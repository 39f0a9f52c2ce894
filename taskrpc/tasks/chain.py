"""The queued tasks as one journey: how long each takes from where the one before it leaves off.

Each priority is a level: its tasks sorted by arrival, with the sum of their seconds. So what lies
ahead of a task that joins the end of a level is a sum over the levels, not over the tasks, and a
task that leaves from the middle changes the plan of the one behind it, not of all.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import NamedTuple, TypeAlias

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.tasks.model import PRIORITY_MAX, PRIORITY_MIN, Key, Task

Planner: TypeAlias = Callable[[Task, Pose], Plan]
"""How long a task takes from a pose, and where it ends; must not raise."""

RUNNING_KEY: Key = (-(PRIORITY_MAX + 1), 0)
"""The place of the task that the robot has in hand: before all that wait."""

_by_arrival = attrgetter("task.arrival")


class Shift(NamedTuple):
    """All tasks behind a place in the order will be done later (or earlier) by some seconds."""

    after: Key
    seconds: float


class _Link:
    """One task with its plan."""

    __slots__ = ("plan", "start", "task")

    def __init__(self, task: Task, start: Pose, plan: Plan) -> None:
        self.task = task
        self.start = start
        self.plan = plan


class _Level:
    """The tasks of one priority, by arrival."""

    __slots__ = ("links", "seconds")

    def __init__(self) -> None:
        self.links: list[_Link] = []
        self.seconds = 0.0

    def add_seconds(self, seconds: float) -> None:
        # An empty level starts afresh, so that rounding errors do not pile up over the years.
        self.seconds = self.seconds + seconds if self.links else 0.0

    def index(self, arrival: int) -> int:
        return bisect_left(self.links, arrival, key=_by_arrival)


class Chain:
    """The queued tasks in the order of run, each planned from the end of the one before it.

    Args:
        plan: see `Planner`.
        base: where the robot will be when the first queued task begins.
    """

    def __init__(self, plan: Planner, base: Pose) -> None:
        self._plan = plan
        self._base = base
        self._levels = {p: _Level() for p in range(PRIORITY_MAX, PRIORITY_MIN - 1, -1)}

    def insert(self, task: Task) -> list[Shift]:
        """Add a task at its place and return by how much those behind it shift."""
        level = self._levels[task.priority]
        at = level.index(task.arrival)
        before = self._before(task.priority, at)
        start = before.plan.end if before else self._base
        link = _Link(task, start, self._plan(task, start))
        level.links.insert(at, link)
        level.add_seconds(link.plan.seconds)
        return self._shifts(task, link.plan.seconds, at + 1)

    def amend(self, task: Task) -> None:
        """Write a task anew that stands here, at the same place and with the same plan."""
        level = self._levels[task.priority]
        level.links[level.index(task.arrival)].task = task

    def remove(self, task: Task) -> list[Shift]:
        """Take a task out and return by how much those behind it shift."""
        level = self._levels[task.priority]
        at = level.index(task.arrival)
        link = level.links.pop(at)
        level.add_seconds(-link.plan.seconds)
        return self._shifts(task, -link.plan.seconds, at)

    def take_first(self) -> Plan:
        """Take the first task out, since its run begins, and return its plan.

        Nobody shifts: its seconds are still ahead of all others, as the running task's.
        """
        level = next(level for level in self._levels.values() if level.links)
        link = level.links.pop(0)
        level.add_seconds(-link.plan.seconds)
        self._base = link.plan.end
        return link.plan

    def rebase(self, base: Pose) -> list[Shift]:
        """Say anew where the robot will be when the first task begins."""
        self._base = base
        return list(self._relink(PRIORITY_MAX, 0))

    def seconds_through(self, task: Task) -> float:
        """Seconds from the start of the first queued task to the end of this one.

        The last of its priority is answered in constant time.
        """
        level = self._levels[task.priority]
        higher = sum(self._levels[p].seconds for p in self._levels if p > task.priority)
        at = level.index(task.arrival)
        if at == len(level.links) - 1:
            return higher + level.seconds
        return higher + sum(link.plan.seconds for link in level.links[: at + 1])

    def walk(self, after: Key = RUNNING_KEY) -> Iterator[tuple[Task, float]]:
        """Iterate over the tasks behind a place, each with its `seconds_through`."""
        seconds = 0.0
        for priority, level in self._levels.items():
            if (-priority, level.links[-1].task.arrival if level.links else 0) <= after:
                seconds += level.seconds
                continue
            for link in level.links:
                seconds += link.plan.seconds
                if link.task.key > after:
                    yield link.task, seconds

    def _before(self, priority: int, at: int) -> _Link | None:
        """The link that stands before a place, None if that is the first."""
        if at:
            return self._levels[priority].links[at - 1]
        higher = range(priority + 1, PRIORITY_MAX + 1)
        return next((self._levels[p].links[-1] for p in higher if self._levels[p].links), None)

    def _links_from(self, priority: int, at: int) -> Iterator[tuple[_Level, _Link]]:
        for lower in range(priority, PRIORITY_MIN - 1, -1):
            level = self._levels[lower]
            yield from ((level, level.links[i]) for i in range(at, len(level.links)))
            at = 0

    def _shifts(self, task: Task, seconds: float, at: int) -> list[Shift]:
        """What a task that came or went means for those behind it, who begin at a place."""
        if next(self._links_from(task.priority, at), None) is None:
            return []
        return [Shift(task.key, seconds), *self._relink(task.priority, at)]

    def _relink(self, priority: int, at: int) -> Iterator[Shift]:
        """Plan anew from a place on, until a task ends where it ended before."""
        before = self._before(priority, at)
        for level, link in self._links_from(priority, at):
            start = before.plan.end if before else self._base
            if link.start == start:
                return
            old, link.start, link.plan = link.plan, start, self._plan(link.task, start)
            level.add_seconds(link.plan.seconds - old.seconds)
            yield Shift(before.task.key if before else RUNNING_KEY, link.plan.seconds - old.seconds)
            before = link
