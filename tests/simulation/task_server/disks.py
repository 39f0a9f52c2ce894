"""The true state of the tasks on each disk of the main server."""

import collections
from typing import NamedTuple

from taskrpc.robot.tasks.model import TRANSITIONS, TaskState

SAME_INSTANT = 1e-4
"""Seconds: a task that changed so shortly before may be seen by the server or not."""


class StoredTask(NamedTuple):
    """A task as a server stores it."""

    task_id: int
    state: str
    priority: int
    arrival: int
    target: str

    @property
    def is_begun(self):
        return TaskState[self.state].is_begun


class Disk:
    """One disk; it checks that tasks change only as allowed, and in which order they begin.

    A task that an earlier life of the server has begun may only be interrupted.
    """

    def __init__(self, number, ledger):
        self.number = number
        self.runs = collections.Counter()
        """How often the robot began each target."""
        self.requeues = collections.Counter()
        """How often each task was queued once more."""
        self._ledger = ledger
        self._tasks = {}
        """What is surely stored."""
        self._unsure = collections.defaultdict(list)
        """What may have been stored, too, until the next life of the server reads it."""
        self._coming = collections.defaultdict(list)
        """What is being stored."""
        self._since = {}
        self._begun = set()
        """The tasks that the server has begun since it read the disk."""
        self._is_new = True
        """Whether a life of the server has not yet read the disk."""

    @property
    def tasks(self):
        return list(self._tasks.values())

    @property
    def is_written(self):
        """Whether the server stores something now."""
        return any(self._coming.values())

    def opened(self):
        """Another life of the server begins: what was being stored may have been stored."""
        for number, coming in self._coming.items():
            self._unsure[number] += coming
        self._coming.clear()
        self._is_new = True

    def loaded(self, tasks):
        """The server has read the disk."""
        found = {each.task_id: each for each in (StoredTask(*task) for task in tasks)}
        for number in {**found, **self._tasks}:
            task, before = found.get(number), self._tasks.get(number)
            if task == before:
                continue
            if task not in self._unsure[number] + self._coming[number]:
                self._ledger.broke("lost", f"task {number} was {before}, read as {task}")
            if task is not None:
                self._store(task)
        if self._is_new:
            self._unsure.clear()
            self._begun.clear()
            self._is_new = False

    def saving(self, tasks):
        """The server begins to store tasks; returns those that it begins."""
        begins = []
        now = self._ledger.now
        for each in tasks:
            task = StoredTask(*each)
            before = self._newest(task.task_id)
            if task.state == "RUNNING" and before and before.state == "QUEUED":
                self._begun.add(task.task_id)
                self._check_order(task)
                begins.append(task)
            self._coming[task.task_id].append(task)
            self._since[task.task_id] = now
        return begins

    def saved(self, numbers):
        for number in numbers:
            self._store(self._coming[number].pop(0))
            self._since[number] = self._ledger.now

    def not_saved(self, numbers, *, is_sure):
        for number in numbers:
            task = self._coming[number].pop(0)
            if not is_sure:
                self._unsure[number].append(task)
            self._since[number] = self._ledger.now

    def moved(self, target):
        """The robot begins the action of a task."""
        self.runs[target] += 1
        task = next((each for each in self._tasks.values() if each.target == target), None)
        if task is None or not task.is_begun:
            self._ledger.broke("robot moved before it was stored", target)
        elif self.runs[target] > 1 + self.requeues[task.task_id]:
            self._ledger.broke("robot moved twice", target)

    def _store(self, task):
        number, before = task.task_id, self._tasks.get(task.task_id)
        if before is None:
            is_allowed = task.state == "QUEUED"
        elif task.state == before.state:
            is_allowed = True
        elif before.is_begun and number not in self._begun:
            is_allowed = task.state == "INTERRUPTED"
        else:
            # One whose end found no room is queued once more from where the disk left it.
            may_become = TRANSITIONS[TaskState[before.state]]
            is_allowed = TaskState[task.state] in may_become or task.state == "QUEUED"
            self.requeues[number] += task.state == "QUEUED"
        if not is_allowed:
            self._ledger.broke("forbidden move", f"{number} was {before}, is {task}")
        self._tasks[number] = task

    def _check_order(self, task):
        """No better task may wait when one begins."""
        place = (-task.priority, task.arrival)
        for number in {**self._tasks, **self._coming}:
            other = self._newest(number)
            is_old = self._since.get(number, -1.0) < self._ledger.now - SAME_INSTANT
            waits = other and other.state == "QUEUED" and is_old
            if waits and (-other.priority, other.arrival) < place:
                self._ledger.broke("out of order", f"task {task.task_id} before {number}")

    def _newest(self, number):
        """A task as it is stored or about to be stored."""
        coming = self._coming.get(number)
        return coming[-1] if coming else self._tasks.get(number)
