"""The order of run: highest priority first, first come first served among equals.

A heap says which task is next; a `Chain` of the same tasks says when each will be done. Nothing is
ever searched for in the heap: a task that is cancelled or moved leaves its entry behind as a
tombstone, which is skipped when it comes up and swept out when half of the heap is dead.
"""

from __future__ import annotations

from asyncio import PriorityQueue
from collections.abc import Iterator
from itertools import count
from typing import TypeAlias

import msgspec

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.tasks.model import Key, Task
from taskrpc.tasks.queue.schedule import RUNNING_KEY, Chain, Planner, Shift

_Entry: TypeAlias = tuple[int, int, int, int]  # -priority, arrival, unique number, task_id


class TaskQueue:
    """The tasks that wait for the robot.

    What changes the order says by how much the tasks behind are shifted. A task that `get` handed
    out still counts as queued until `begin`; `put_back` returns it to its old place.

    Args:
        plan: how long a task takes from a pose, and where it ends; must not raise.
        base: where the robot will be when the first task begins.
    """

    def __init__(self, plan: Planner, base: Pose) -> None:
        self._heap: PriorityQueue[_Entry] = PriorityQueue()
        self._numbers = count()
        self._live: dict[int, int] = {}  # task_id -> number of its only valid entry
        self._tasks: dict[int, Task] = {}
        self._chain = Chain(plan, base)

    def __len__(self) -> int:
        return len(self._tasks)

    def __contains__(self, task_id: int) -> bool:
        return task_id in self._tasks

    def find(self, task_id: int) -> Task | None:
        """Return the queued task of this number, None if it does not wait here."""
        return self._tasks.get(task_id)

    def waiting_of(self, account: str, machine: str) -> int:
        """How many tasks of an account wait that came from a machine."""
        # Looked for, not counted along: whoever has shares has short queues.
        who = account, machine
        return sum((task.client, task.machine) == who for task in self._tasks.values())

    def put(self, task: Task) -> list[Shift]:
        """Add a task at the place that its priority and arrival give it."""
        if task.task_id in self._tasks:
            raise ValueError(f"task {task.task_id} is queued already")
        self._tasks[task.task_id] = task
        self._enter(task)
        return self._chain.insert(task)

    async def get(self) -> Task:
        """Wait until there is a task, and hand out the one that is first."""
        while True:
            _, _, number, task_id = await self._heap.get()
            if self._live.get(task_id) == number:
                del self._live[task_id]
                return self._tasks[task_id]

    def put_back(self, task: Task) -> None:
        """Undo a `get`: the task stands where it stood."""
        self._enter(task)

    def begin(self, task: Task) -> Plan:
        """Let a task that `get` handed out leave the queue, because its run begins."""
        del self._tasks[task.task_id]
        return self._chain.take_first()

    def amend(self, task: Task) -> None:
        """Write a queued task anew where only what has nothing to do with its place differs."""
        self._chain.amend(task)
        self._tasks[task.task_id] = task

    def remove(self, task_id: int) -> list[Shift]:
        """Take a task out of the queue.

        Raises:
            KeyError: it is not queued.
        """
        shifts = self._chain.remove(self._tasks.pop(task_id))
        self._live.pop(task_id, None)
        self._sweep()
        return shifts

    def rerank(self, task_id: int, priority: int) -> list[Shift]:
        """Move a task to another priority; its arrival decides its place among its new equals.

        Raises:
            KeyError: it is not queued.
        """
        moved = msgspec.structs.replace(self._tasks[task_id], priority=priority)
        return [*self.remove(task_id), *self.put(moved)]

    def rebase(self, base: Pose) -> list[Shift]:
        """Say anew where the robot will be when the first task begins."""
        return self._chain.rebase(base)

    def seconds_through(self, task: Task) -> float:
        """Robot seconds from the start of the first task to the end of this one."""
        return self._chain.seconds_through(task)

    def ordered(self, after: Key = RUNNING_KEY) -> Iterator[tuple[Task, float]]:
        """Iterate over the tasks behind a place, in the order of run, with `seconds_through`."""
        return self._chain.walk(after)

    def _enter(self, task: Task) -> None:
        number = next(self._numbers)
        self._live[task.task_id] = number
        self._heap.put_nowait((*task.key, number, task.task_id))

    def _sweep(self) -> None:
        if self._heap.qsize() <= 2 * len(self._live):
            return
        entries = [self._heap.get_nowait() for _ in range(self._heap.qsize())]
        for entry in entries:
            if self._live.get(entry[3]) == entry[2]:
                self._heap.put_nowait(entry)
