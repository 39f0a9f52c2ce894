"""The task queue: priority 10 first, first come first served among equals.

A heap yields the next task; a `Schedule` of the same tasks says when each task ends. Both order
the tasks by `Task.order_key`. The queue never searches the heap: the heap entry of a task that was
cancelled or moved stays as a tombstone. `get` skips tombstones, and the queue removes them once
they are half of the heap.
"""

from __future__ import annotations

from asyncio import PriorityQueue
from collections.abc import Iterator
from itertools import count
from typing import TypeAlias

import msgspec

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import RUNNING_KEY, OrderKey, Task
from taskrpc.robot.tasks.queue.schedule import Planner, Schedule, Shift

_Entry: TypeAlias = tuple[int, int, int, int]  # the order key, entry number, task_id


class TaskQueue:
    """The tasks that wait for the robot.

    Methods that change the order return the shifts of the tasks behind. A task that `get` returned
    still counts as queued until `begin`; `put_back` returns it to its old place.

    Args:
        plan: see `Planner`.
        start_pose: where the robot will be when the first task begins.
    """

    def __init__(self, plan: Planner, start_pose: Pose) -> None:
        self._heap: PriorityQueue[_Entry] = PriorityQueue()
        self._entry_numbers = count()
        # task_id -> the number of its only valid heap entry; every other entry is a tombstone
        self._valid_entries: dict[int, int] = {}
        self._tasks: dict[int, Task] = {}
        self._schedule = Schedule(plan, start_pose)

    def __len__(self) -> int:
        return len(self._tasks)

    def __contains__(self, task_id: int) -> bool:
        return task_id in self._tasks

    def find(self, task_id: int) -> Task | None:
        """Return the queued task with this id, None if it is not queued."""
        return self._tasks.get(task_id)

    def count_waiting(self, account: str, machine: str) -> int:
        """Return the number of queued tasks that an account submitted from a machine."""
        # Searched, not counted on every change: servers with shares have short queues.
        submitter = account, machine
        return sum((task.client, task.machine) == submitter for task in self._tasks.values())

    def put(self, task: Task) -> list[Shift]:
        """Add a task at its place; returns the shifts of the tasks behind it."""
        if task.task_id in self._tasks:
            raise ValueError(f"task {task.task_id} is queued already")
        self._tasks[task.task_id] = task
        self._push(task)
        return self._schedule.insert(task)

    async def get(self) -> Task:
        """Wait for a task; returns the first one of the queue."""
        while True:
            _, _, number, task_id = await self._heap.get()
            if self._valid_entries.get(task_id) == number:
                del self._valid_entries[task_id]
                return self._tasks[task_id]

    def put_back(self, task: Task) -> None:
        """Undo a `get`: return the task to its old place."""
        self._push(task)

    def begin(self, task: Task) -> Plan:
        """Remove a task that `get` returned because its execution begins; returns its plan."""
        del self._tasks[task.task_id]
        return self._schedule.take_first()

    def replace(self, task: Task) -> None:
        """Replace a queued task by a newer value that has the same place and plan."""
        self._schedule.replace(task)
        self._tasks[task.task_id] = task

    def remove(self, task_id: int) -> list[Shift]:
        """Take a task out of the queue; returns the shifts of the tasks behind it.

        Raises:
            KeyError: it is not queued.
        """
        shifts = self._schedule.remove(self._tasks.pop(task_id))
        self._valid_entries.pop(task_id, None)
        self._remove_tombstones()
        return shifts

    def reprioritise(self, task_id: int, priority: int) -> list[Shift]:
        """Change a task's priority; its arrival decides its place among its new equals.

        Raises:
            KeyError: it is not queued.
        """
        moved = msgspec.structs.replace(self._tasks[task_id], priority=priority)
        return [*self.remove(task_id), *self.put(moved)]

    def set_start_pose(self, pose: Pose) -> list[Shift]:
        """Set where the robot will be when the first task begins; returns the shifts."""
        return self._schedule.set_start_pose(pose)

    def seconds_through(self, task: Task) -> float:
        """Return the robot seconds from the start of the first task to the end of this one."""
        return self._schedule.seconds_through(task)

    def seconds_with(self, task: Task) -> float:
        """Return what `seconds_through` would return if this task were in the queue."""
        return self._schedule.seconds_with(task)

    def ordered(self, after: OrderKey = RUNNING_KEY) -> Iterator[tuple[Task, float]]:
        """Iterate over the tasks behind a place, in order, each with its `seconds_through`."""
        return self._schedule.tasks_after(after)

    def _push(self, task: Task) -> None:
        number = next(self._entry_numbers)
        self._valid_entries[task.task_id] = number
        self._heap.put_nowait((*task.order_key, number, task.task_id))

    def _remove_tombstones(self) -> None:
        if self._heap.qsize() <= 2 * len(self._valid_entries):
            return
        entries = [self._heap.get_nowait() for _ in range(self._heap.qsize())]
        for entry in entries:
            if self._valid_entries.get(entry[3]) == entry[2]:
                self._heap.put_nowait(entry)
