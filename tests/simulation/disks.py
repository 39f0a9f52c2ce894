"""Simulated disks that are slow, fill up and fail, with the true state of their tasks."""

from __future__ import annotations

import asyncio
import collections

from taskrpc import OutcomeUnknown, StoreError
from taskrpc.core.exactly_once.stores import MemoryCompletions
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.history import DEFAULT
from taskrpc.robot.tasks.records.store import MemoryStore


class Disk(MemoryStore):
    """The data that survives: the tasks, and the completions of the exactly-once service.

    It checks each write: a task changes its state only as allowed, and a task that another life of
    the server has started is only ever interrupted.
    """

    def __init__(self, number, ledger):
        super().__init__()
        self.number = number
        self.completions = MemoryCompletions()
        self.ails = True
        """Whether commits and reads may fail."""
        self.is_full = False
        self.requeues = collections.Counter()
        """How often each task was queued once more."""
        self._ledger = ledger

    async def store(self, begun, saved, forgotten, completion, clients):
        """Apply changes for a life of the server that has started the tasks `begun`."""
        for task in saved:
            self._check(begun, self._tasks.get(task.task_id), task)
        await self.apply(saved, forgotten, completion, clients)
        for task in saved:
            self._ledger.note(f"stored {task.task_id} {task.state.value} {task.priority}")

    def _check(self, begun, before, task):
        number = task.task_id
        if before is None:
            allowed = task.state is TaskState.QUEUED
        elif task.state is before.state:
            allowed = True
        elif before.state.is_begun and number not in begun:
            allowed = task.state is TaskState.INTERRUPTED
        else:
            # One whose end found no room is queued once more from where the disk left it.
            allowed = task.state in before.may_become or task.state is TaskState.QUEUED
            self.requeues[number] += task.state is TaskState.QUEUED
        if not allowed:
            was = before.state.value if before else "not there"
            self._ledger.broke("forbidden move", f"{number} was {was}, is {task.state.value}")

    def task_of(self, target):
        """The task with this target, or None."""
        return next((task for task in self._tasks.values() if task.target == target), None)


class File:
    """One server's open file on a disk: each write takes time, and takes effect at one instant.

    A commit may fail without a change, or fail with an unknown outcome. After that the file
    refuses every operation until it is reopened. `strike` may kill the server during a commit.
    """

    def __init__(self, disk, chance, strike, counts):
        self.disk = disk
        self._strike = strike
        self._chance = chance
        self._counts = counts
        self._turn = asyncio.Lock()
        self.is_broken = False

    async def write(self, write):
        async with self._turn:
            self._check()
            if self._chance.random() < 0.03:
                self._strike(self._chance.uniform(0.0, 0.03))
            await self._wait()
            if self.disk.is_full:
                self._counts["no room"] += 1
                raise StoreError("the disk is full; nothing was stored")
            if self.disk.ails and self._chance.random() < 0.04:
                await self._fail(write)
            await write()
            await self._wait()

    async def read(self):
        """Wait until the file can be read."""
        await self._wait()
        self._check()
        if self.disk.ails and self._chance.random() < 0.02:
            self._counts["failed reads"] += 1
            raise StoreError("the file cannot be read")

    def open_anew(self):
        """Make the disk readable again."""
        self.is_broken = False

    async def _fail(self, write):
        if self._chance.random() < 0.6:
            self._counts["failed commits"] += 1
            raise StoreError("nothing was stored")
        self._counts["unknown commits"] += 1
        self.is_broken = True
        if self._chance.random() < 0.5:
            await write()
        raise OutcomeUnknown("it is unknown whether it was stored")

    def _check(self):
        if self.is_broken:
            raise StoreError("the file cannot be used before it is opened anew")

    async def _wait(self):
        await asyncio.sleep(self._chance.choice((0.0, 0.002, 0.03)) * self._chance.random())


class TaskDisk:
    """The `TaskStore` of a simulated server; compares each started task with the queued ones."""

    def __init__(self, file, ledger):
        self._file = file
        self._ledger = ledger
        self._loop = asyncio.get_running_loop()
        self._known = {}
        self._on_their_way = collections.defaultdict(list)
        self._since = {}
        self._begun = set()
        self.history = DEFAULT

    async def load(self):
        await self._file.read()
        stored = await self._file.disk.load()
        for task in stored.tasks:
            self._known.setdefault(task.task_id, task)
        return stored

    async def apply(self, saved, forgotten=(), completion=None, clients=()):
        for task in saved:
            self._asked_for(task)
        disk = self._file.disk
        try:
            await self._file.write(
                lambda: disk.store(self._begun, saved, forgotten, completion, clients)
            )
        except BaseException:
            for task in saved:
                self._arrived(task)
            raise
        for task in saved:
            self._known[task.task_id] = task
            self._arrived(task)

    async def remember_pause(self, paused):
        disk = self._file.disk
        await self._file.write(lambda: disk.remember_pause(paused))

    async def clear(self):
        await self._file.write(self._file.disk.clear)

    async def close(self):
        pass

    def _asked_for(self, task):
        before = self._newest(task.task_id)
        if task.state is TaskState.RUNNING and before and before.state is TaskState.QUEUED:
            self._begun.add(task.task_id)
            # What changed in this very instant may be seen or not.
            now = self._loop.time()
            others = (self._newest(number) for number in (*self._known, *self._on_their_way))
            waiting = [
                each
                for each in others
                if each
                and each.state is TaskState.QUEUED
                and self._since.get(each.task_id, -1.0) < now
            ]
            self._ledger.chosen(self._file.disk, task, waiting)
        self._on_their_way[task.task_id].append(task)
        self._since[task.task_id] = self._loop.time()

    def _arrived(self, task):
        self._on_their_way[task.task_id].remove(task)
        self._since[task.task_id] = self._loop.time()

    def _newest(self, number):
        """A task as it is stored or about to be stored."""
        coming = self._on_their_way.get(number)
        return coming[-1] if coming else self._known.get(number)


class EffectDisk:
    """The `CompletionStore` of a simulated server."""

    def __init__(self, file):
        self._file = file

    async def recall(self):
        self._file.open_anew()
        await self._file.read()
        return await self._file.disk.completions.recall()

    async def complete(self, completion, effect, forgotten=()):
        async def write():
            self._file.disk.completions.complete(completion, effect, forgotten)

        await self._file.write(write)
