"""A server's copy of the fleet's records, and the changes of one transaction.

The copy follows the database by revisions. A transaction first brings it up to date, then changes
it, then writes the changes. If it fails, `undo` restores the copy.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any

import msgspec

from taskrpc.robot.fleet.model import REMEMBERED, Abilities, Meta, RobotRecord
from taskrpc.robot.tasks.model import BEFORE_RUNNING_KEY, OrderKey, Task, TaskState
from taskrpc.robot.tasks.records.history import AT_ONCE, DEFAULT, History, newest_end
from taskrpc.spi import ClientKey, Completion


class Changes(msgspec.Struct):
    """What one transaction has changed."""

    meta: bool = False
    tasks: dict[int, Task | None] = {}
    """By id; None for a forgotten task."""
    ends: dict[int, float] = {}
    """When the forgotten tasks ended, by id."""
    robots: dict[str, RobotRecord] = {}
    completions: list[tuple[Completion | None, tuple[ClientKey, ...]]] = []
    """Each completion, with the clients to forget before it."""
    cleared: bool = False
    """Whether everything is forgotten first, completions included."""
    notifies: bool = False
    """Whether to notify the other servers: more than a lease has changed."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing has changed."""
        return not (self.meta or self.tasks or self.robots or self.completions or self.cleared)

    def newest_end(self) -> float | None:
        """Return when the last of the changed tasks ended; None if none of them has ended."""
        return newest_end(task for task in self.tasks.values() if task is not None)


class FleetState:
    """All records of a fleet.

    Args:
        history: which ended tasks are kept.
    """

    def __init__(self, *, history: History = DEFAULT) -> None:
        self.history = history
        self.meta = Meta()
        self.tasks: dict[int, Task] = {}
        self.robots: dict[str, RobotRecord] = {}
        self.interrupted: dict[int, None] = {}
        """An ordered set of task ids."""
        self.begun: dict[int, None] = {}
        """An ordered set of the ids of tasks that robots execute."""
        self.changes = Changes()
        """What the running transaction has changed."""
        self.plan_version = 0
        """Grows whenever a plan of the queue becomes invalid; not for tasks behind all others."""
        self._queue: list[tuple[int, int, int]] = []  # level, arrival, id: sorted
        self._ended: dict[int, None] = {}  # ids, the oldest end first; without the interrupted
        self._leftover: list[Task] = []  # rows that servers with a longer history kept
        self._undo: list[Callable[[], object]] = []
        self._abilities: Abilities | None = None

    # Queries

    def __len__(self) -> int:
        """The number of queued tasks."""
        return len(self._queue)

    def queued(self, after: OrderKey = BEFORE_RUNNING_KEY) -> Iterator[Task]:
        """Iterate over the queued tasks behind a place, in the order of execution."""
        start = bisect_right(self._queue, (*after, 2**63))
        return (self.tasks[task_id] for _, _, task_id in islice(self._queue, start, None))

    def queued_at(self, position: int) -> Task | None:
        """Return the queued task at a place in the order of execution, None behind the last."""
        if position >= len(self._queue):
            return None
        return self.tasks[self._queue[position][2]]

    def position(self, task: Task) -> int:
        """Return how many queued tasks are ahead of a queued task."""
        return bisect_right(self._queue, (*task.order_key, task.task_id)) - 1

    def count_waiting(self, account: str, machine: str) -> int:
        """Return the number of queued tasks that an account submitted from a machine."""
        submitter = account, machine
        return sum((task.client, task.machine) == submitter for task in self.queued())

    def ended(self) -> Iterator[Task]:
        """Iterate over the ended tasks: the interrupted ones, then the others, newest first."""
        task_ids = (*reversed(self.interrupted), *reversed(self._ended))
        return (self.tasks[task_id] for task_id in task_ids)

    def live_robots(self, now: float) -> list[RobotRecord]:
        """Return the robots whose servers hold a lease, sorted by name."""
        live = (robot for robot in self.robots.values() if robot.is_live(now))
        return sorted(live, key=lambda robot: robot.name)

    def known_robots(self, now: float) -> list[RobotRecord]:
        """Return the robots with a lease, and those that had one lately, sorted by name."""
        known = (each for each in self.robots.values() if each.lease_until > now - REMEMBERED)
        return sorted(known, key=lambda robot: robot.name)

    def working_robots(self, now: float) -> list[RobotRecord]:
        """Return the robots with a lease that no operator has paused, sorted by name."""
        return [robot for robot in self.live_robots(now) if not robot.paused]

    def abilities(self) -> Abilities:
        """Return which robots can execute which tasks."""
        if self._abilities is None:
            self._abilities = Abilities(list(self.robots.values()))
        return self._abilities

    # Changes in a transaction

    def set_meta(self, **values: int | bool | str) -> None:
        """Change facts about the whole fleet."""
        before = self.meta
        self._undo.append(lambda: setattr(self, "meta", before))
        self.meta = msgspec.structs.replace(before, **values)
        self.changes.meta = self.changes.notifies = True

    def put_task(self, task: Task) -> None:
        """Add a task, or replace an earlier value of it; forget the oldest ended tasks."""
        self._change_task(task.task_id, task)
        if not task.state.is_ended:
            return
        if leftover := self._leftover:
            self._undo.append(lambda: setattr(self, "_leftover", leftover))
            self._leftover = leftover[AT_ONCE:]
        surplus = (self.tasks[task_id] for task_id in self._surplus(task.ended_at or 0.0))
        for ended in [*leftover[:AT_ONCE], *surplus]:
            self._forget(ended)

    def _surplus(self, now: float) -> list[int]:
        ended = (self.tasks[task_id] for task_id in self._ended)
        return self.history.surplus(ended, len(self._ended), now)

    def forget_task(self, task_id: int) -> None:
        """Forget a task."""
        self._forget(self.tasks[task_id])

    def _forget(self, task: Task) -> None:
        if task.state.is_ended:
            self._undo.append(_restore(self.changes.ends, task.task_id))
            self.changes.ends[task.task_id] = task.ended_at or 0.0
        self._change_task(task.task_id, None)

    def put_robot(self, robot: RobotRecord, *, notifies: bool = True) -> None:
        """Add a robot, or replace an earlier record of it."""
        before = self.robots.get(robot.name)
        self._undo.append(lambda: self._set_robot(robot.name, before))
        self._undo.append(_restore(self.changes.robots, robot.name))
        self._set_robot(robot.name, robot)
        self.changes.robots[robot.name] = robot
        self.changes.notifies |= notifies

    def complete(self, completion: Completion | None, clients: Iterable[ClientKey] = ()) -> None:
        """Forget the completions of clients, then remember a completion."""
        forgotten = tuple(clients)
        if completion is not None or forgotten:
            self.changes.completions.append((completion, forgotten))
            self._undo.append(self.changes.completions.pop)

    def clear(self) -> None:
        """Forget everything except the robots."""
        for task_id in list(self.tasks):
            self.forget_task(task_id)
        self.set_meta(next_id=1, next_arrival=1, paused=False)
        self.changes.cleared = True
        self.changes.completions.clear()

    # The transaction

    def mark(self) -> int:
        """Return the present moment, for `undo`."""
        return len(self._undo)

    def undo(self, mark: int = 0) -> None:
        """Undo all changes of the transaction since a moment."""
        while len(self._undo) > mark:
            self._undo.pop()()
        if not mark:
            self.changes = Changes()

    def take_changes(self) -> Changes:
        """Return the changes of the transaction and begin the next transaction."""
        changes, self.changes = self.changes, Changes()
        self._undo.clear()
        return changes

    # Following the database

    def replace(
        self, meta: Meta, tasks: Iterable[Task], robots: Iterable[RobotRecord]
    ) -> list[int]:
        """Take over rows of the database; returns the ids of the changed tasks."""
        changed, is_first, newest = [], not self.tasks, 0.0
        for task in tasks:
            newest = max(newest, task.ended_at or 0.0)
            if self.tasks.get(task.task_id) != task:
                self._set_task(task.task_id, task)
                changed.append(task.task_id)
        for robot in robots:
            self._set_robot(robot.name, robot)
        self.meta = meta
        while surplus := self._surplus(newest):  # the server that ended a task has removed it
            if is_first:
                self._leftover += (self.tasks[task_id] for task_id in surplus)
            for task_id in surplus:
                self._set_task(task_id, None)
        return changed

    def forget_all(self) -> None:
        """Forget everything, before all rows are read again."""
        fresh = FleetState(history=self.history)
        fresh.plan_version = self.plan_version + 1  # else an old plan could count as this one's
        self.__dict__.update(fresh.__dict__)

    def _change_task(self, task_id: int, task: Task | None) -> None:
        before = self.tasks.get(task_id)
        self._undo.append(lambda: self._set_task(task_id, before))
        self._undo.append(_restore(self.changes.tasks, task_id))
        self._set_task(task_id, task)
        self.changes.tasks[task_id] = task
        self.changes.notifies = True

    def _set_task(self, task_id: int, task: Task | None) -> None:
        before = self.tasks.pop(task_id, None)
        if before is not None and task is not None and _is_same_work(before, task):
            self.tasks[task_id] = task
            return
        if before is not None:
            if before.state is TaskState.QUEUED:
                key = (*before.order_key, task_id)
                del self._queue[bisect_right(self._queue, key) - 1]
                self.plan_version += 1
            for kind in (self._ended, self.interrupted, self.begun):
                kind.pop(task_id, None)
        if task is None:
            return
        self.tasks[task_id] = task
        if task.state is TaskState.QUEUED:
            self._insert((*task.order_key, task_id))
        elif task.state.is_begun:
            self.begun[task_id] = None
        elif task.state is TaskState.INTERRUPTED:
            self.interrupted[task_id] = None
        else:
            self._ended[task_id] = None

    def _insert(self, key: tuple[int, int, int]) -> None:
        if self._queue and key < self._queue[-1]:
            self.plan_version += 1
        insort(self._queue, key)

    def _set_robot(self, name: str, robot: RobotRecord | None) -> None:
        before = self.robots.pop(name, None)
        if robot is not None:
            self.robots[name] = robot
        if before is None or robot is None or _skills(before) != _skills(robot):
            self._abilities = None
        if before is None or robot is None or _progress(before) != _progress(robot):
            self.plan_version += 1


def _is_same_work(before: Task, task: Task) -> bool:
    """Whether two values of a queued task have the same place and the same plan."""
    return (
        before.state is task.state is TaskState.QUEUED
        and before.order_key == task.order_key
        and (before.task_type, before.target) == (task.task_type, task.target)
    )


def _progress(robot: RobotRecord) -> tuple[object, ...]:
    return robot.pose, robot.free_at, robot.task_id, robot.is_gone, robot.paused


def _skills(robot: RobotRecord) -> tuple[object, ...]:
    return robot.task_types, robot.capabilities, robot.places, robot.size, robot.tells_all


def _restore(values: dict[Any, Any], key: object) -> Callable[[], object]:
    """Return a function that gives a key of a dict its present value back."""
    if key not in values:
        return lambda: values.pop(key, None)
    before = values[key]
    return lambda: values.__setitem__(key, before)
