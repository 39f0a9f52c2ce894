"""Records, planners and fleets in memory, for the tests of this folder."""

from __future__ import annotations

import asyncio

from taskrpc.robot.fleet import FleetManager, FleetSettings, MemoryFleet, MemoryFleetStore
from taskrpc.robot.fleet.model import RobotRecord
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import Task
from tests.robot.tasks.fakes import LineRobot


def pose(x=0.0):
    return Pose(float(x), 0.0, 0.0)


def robot(name, x=0.0, **fields):
    known = {"server": f"server of {name}", "task_types": ("move", "scan"), "lease_until": 1e9}
    return RobotRecord(name=name, pose=pose(x), **(known | fields))


def task(number, target="1", **fields):
    known = {"task_type": "move", "priority": 5, "arrival": number, "submitted_at": 0.0}
    return Task(task_id=number, target=target, **(known | fields))


def line_plan(robot, task_type, target, start):
    """A second for each metre, and one for the work."""
    x = float(target)
    return Plan(abs(x - start.x) + 1.0, pose(x))


def state_of(*records):
    """A state with these robots and tasks."""
    state = FleetState()
    for record in records:
        if isinstance(record, Task):
            state.put_task(record)
            if record.task_id >= state.meta.next_id:
                state.set_meta(next_id=record.task_id + 1, next_arrival=record.arrival + 1)
        else:
            state.put_robot(record)
    state.take_changes()
    return state


class Fleet:
    """Servers of a fleet in memory, on the event loop's clock."""

    def __init__(self):
        loop = asyncio.get_running_loop()
        self.database = MemoryFleet(lambda: 1000.0 + loop.time())
        self.managers = {}
        self.robots = {}

    async def add(self, name, robot=None, **settings):
        """Start a server and return its manager."""
        self.robots[name] = robot or RecordingRobot(self, name)
        store = MemoryFleetStore(self.database)
        known = {"settle": 0.0} | settings
        manager = FleetManager(self.robots[name], store, FleetSettings(name=name, **known))
        await manager.start()
        self.managers[name] = manager
        return manager

    def cut_off(self, name, is_cut_off=True):
        """Separate a server from the database, or connect it again."""
        self.managers[name].store.is_cut_off = is_cut_off

    def tasks(self):
        return {number: task for number, (_, task) in sorted(self.database.tasks.items())}

    def states(self):
        return {number: task.state.value for number, task in self.tasks().items()}

    async def until(self, condition, seconds=1000.0):
        async with asyncio.timeout(seconds):
            while not condition():
                await asyncio.sleep(0.05)

    async def until_done(self, seconds=1000.0):
        await self.until(lambda: all(t.state.is_ended for t in self.tasks().values()), seconds)

    async def close(self):
        for manager in self.managers.values():
            manager.store.is_cut_off = False
        await asyncio.gather(*(manager.close() for manager in self.managers.values()))


class RecordingRobot(LineRobot):
    """A robot on a line that notes when it executes; two tasks at once fail."""

    def __init__(self, fleet, name):
        super().__init__()
        self.name = name
        self.runs = []
        """(target, begin, end) on the loop's clock."""

    async def execute(self, task_type, target, report):
        loop = asyncio.get_running_loop()
        began = loop.time()
        try:
            return await super().execute(task_type, target, report)
        finally:
            self.runs.append((target, began, loop.time()))
