"""The queued tasks as one journey: how long each takes from where the one before it leaves off.

Each priority is a level: its tasks by arrival, weighed by their seconds. So what lies ahead of a
task is a sum over some levels and a part of one, not over the tasks, and a task that leaves from
the middle changes the plan of the one behind it, not of all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import NamedTuple, TypeAlias

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.tasks.model import PRIORITY_MAX, PRIORITY_MIN, Key, Task
from taskrpc.tasks.queue.sum_tree import SumTree

Planner: TypeAlias = Callable[[Task, Pose], Plan]
"""How long a task takes from a pose, and where it ends; must not raise."""

RUNNING_KEY: Key = (-(PRIORITY_MAX + 1), 0)
"""The place of the task that the robot has in hand: before all that wait."""


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


class Chain:
    """The queued tasks in the order of run, each planned from the end of the one before it.

    Args:
        plan: see `Planner`.
        base: where the robot will be when the first queued task begins.
    """

    def __init__(self, plan: Planner, base: Pose) -> None:
        self._plan = plan
        self._base = base
        self._levels: dict[int, SumTree[_Link]] = {
            p: SumTree() for p in range(PRIORITY_MAX, PRIORITY_MIN - 1, -1)
        }
        self._links: dict[int, _Link] = {}  # by arrival

    def insert(self, task: Task) -> list[Shift]:
        """Add a task at its place and return by how much those behind it shift."""
        before = self._before(task.priority, task.arrival)
        start = before.plan.end if before else self._base
        link = _Link(task, start, self._plan(task, start))
        self._levels[task.priority].insert(task.arrival, link, link.plan.seconds)
        self._links[task.arrival] = link
        return self._shifts(task, link.plan.seconds, link)

    def amend(self, task: Task) -> None:
        """Write a task anew that stands here, at the same place and with the same plan."""
        self._links[task.arrival].task = task

    def remove(self, task: Task) -> list[Shift]:
        """Take a task out and return by how much those behind it shift."""
        link = self._levels[task.priority].remove(task.arrival)
        del self._links[task.arrival]
        return self._shifts(task, -link.plan.seconds, self._before(task.priority, task.arrival))

    def take_first(self) -> Plan:
        """Take the first task out, since its run begins, and return its plan.

        Nobody shifts: its seconds are still ahead of all others, as the running task's.
        """
        first = next(self._links_behind(RUNNING_KEY))
        self._levels[first.task.priority].remove(first.task.arrival)
        del self._links[first.task.arrival]
        self._base = first.plan.end
        return first.plan

    def rebase(self, base: Pose) -> list[Shift]:
        """Say anew where the robot will be when the first task begins."""
        if base == self._base:
            return []
        self._base = base
        return list(self._relink(self._links_behind(RUNNING_KEY), None))

    def seconds_through(self, task: Task) -> float:
        """Seconds from the start of the first queued task to the end of this one."""
        higher = 0.0
        for priority, level in self._levels.items():
            if priority <= task.priority:
                break
            higher += level.weight
        return higher + self._levels[task.priority].weight_through(task.arrival)

    def walk(self, after: Key = RUNNING_KEY) -> Iterator[tuple[Task, float]]:
        """Iterate over the tasks behind a place, each with its `seconds_through`."""
        seconds = 0.0
        for priority, level in self._levels.items():
            if -priority < after[0]:
                seconds += level.weight
            elif -priority == after[0]:
                seconds += level.weight_through(after[1])
        for link in self._links_behind(after):
            seconds += link.plan.seconds
            yield link.task, seconds

    def _before(self, priority: int, arrival: int) -> _Link | None:
        """The link that stands before a place, None if that is the first."""
        if before := self._levels[priority].before(arrival):
            return before
        higher = range(priority + 1, PRIORITY_MAX + 1)
        return next((self._levels[p].last() for p in higher if self._levels[p]), None)

    def _links_behind(self, key: Key) -> Iterator[_Link]:
        for priority, level in self._levels.items():
            if -priority >= key[0] and level:
                yield from level.behind(key[1] if -priority == key[0] else -1)

    def _shifts(self, task: Task, seconds: float, before: _Link | None) -> list[Shift]:
        """What a task that came or went means for those behind it, whom now a link precedes."""
        behind = self._links_behind(task.key)
        if (first := next(behind, None)) is None:
            return []
        return [Shift(task.key, seconds), *self._relink(chain((first,), behind), before)]

    def _relink(self, links: Iterable[_Link], before: _Link | None) -> Iterator[Shift]:
        """Plan anew from a place on, until a task ends where it ended before."""
        for link in links:
            start = before.plan.end if before else self._base
            if link.start == start:
                return
            old, link.start, link.plan = link.plan, start, self._plan(link.task, start)
            self._levels[link.task.priority].weigh(link.task.arrival, link.plan.seconds)
            yield Shift(before.task.key if before else RUNNING_KEY, link.plan.seconds - old.seconds)
            before = link
