"""What stands around the simulated servers: disks that take their time, and a robot that counts."""

from __future__ import annotations

import asyncio

from taskrpc import Plan, Pose
from taskrpc.storage.stores import MemoryCompletions
from taskrpc.tasks.model import State
from taskrpc.tasks.store import MemoryStore

WALL = 1_800_000_000.0
"""Seconds since 1970 when a simulation begins."""


class Disk(MemoryStore):
    """What survives: the tasks, and the completions of the exactly-once service."""

    def __init__(self):
        super().__init__()
        self.completions = MemoryCompletions()


class Arm:
    """One server's access to a disk: each write takes time, and is done at one instant of it.

    `strike` may end the server in the midst of it.
    """

    def __init__(self, disk, chance, strike):
        self.disk = disk
        self._strike = strike
        self._chance = chance
        self._turn = asyncio.Lock()

    async def write(self, write):
        async with self._turn:
            if self._chance.random() < 0.03:
                self._strike(self._chance.uniform(0.0, 0.03))
            await self.wait()
            await write()
            await self.wait()

    async def wait(self):
        await asyncio.sleep(self._chance.choice((0.0, 0.002, 0.03)) * self._chance.random())


class TaskDisk:
    """The `TaskStore` of a simulated server."""

    def __init__(self, arm, ledger):
        self._arm = arm
        self._ledger = ledger
        self._newest = {}

    async def load(self):
        await self._arm.wait()
        stored = await self._arm.disk.load()
        self._newest = {task.task_id: task for task in stored.tasks} | self._newest
        return stored

    async def apply(self, saved, forgotten=(), completion=None, clients=()):
        for task in saved:
            before = self._newest.get(task.task_id)
            if task.state is State.RUNNING and before and before.state is State.QUEUED:
                waiting = [each for each in self._newest.values() if each.state is State.QUEUED]
                self._ledger.chosen(task, waiting)
            self._newest[task.task_id] = task
        disk = self._arm.disk
        await self._arm.write(lambda: disk.apply(saved, forgotten, completion, clients))
        for task in saved:
            self._ledger.note(f"stored {task.task_id} {task.state.value}")

    async def remember_pause(self, paused):
        disk = self._arm.disk
        await self._arm.write(lambda: disk.remember_pause(paused))

    async def clear(self):
        disk = self._arm.disk
        await self._arm.write(disk.clear)

    async def close(self):
        pass


class EffectDisk:
    """The `CompletionStore` of a simulated server."""

    def __init__(self, arm):
        self._arm = arm

    async def recall(self):
        await self._arm.wait()
        return await self._arm.disk.completions.recall()

    async def complete(self, completion, effect, forgotten=()):
        async def write():
            self._arm.disk.completions.complete(completion, effect, forgotten)

        await self._arm.write(write)


class CountingRobot:
    """Does nothing but take its time, and tells the ledger."""

    speed = 1.0
    task_types = ("move",)

    def __init__(self, ledger, chance):
        self._ledger = ledger
        self._chance = chance
        self._left = 0.0

    def plan(self, task_type, target, start):
        return Plan(0.3, start)

    def pose(self):
        return Pose(0.0, 0.0, 0.0)

    async def execute(self, task_type, target, report):
        self._ledger.moved(target)
        self._left = self._chance.uniform(0.05, 0.8)
        try:
            await asyncio.sleep(self._left)
        finally:
            self._left = 0.0
        return {}

    def remaining(self):
        return self._left

    def pause(self):
        pass

    def resume(self):
        pass

    def stop(self):
        pass
