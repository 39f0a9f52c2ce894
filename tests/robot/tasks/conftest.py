"""A robot, a store and a task manager, for the tests of this folder."""

from __future__ import annotations

import asyncio

import pytest

from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from tests.robot.tasks.fakes import FullStore, LineRobot


class Scene:
    """A manager with its robot and store, and the changes that a watcher saw."""

    def __init__(self, settle):
        self.robot, self.store = LineRobot(), FullStore()
        self.manager = TaskManager(self.robot, self.store, TaskSettings(settle=settle))
        self.seen = []
        self._watcher = None

    async def submit(self, *targets, priority=5):
        return [(await self.manager.submit("move", t, priority)).task_id for t in targets]

    def state(self, task_id):
        return self.manager.repository.find(task_id).state

    def states(self, task_id):
        """The states of one task in the order in which a watcher saw them."""
        return [state.value for number, state in self.seen if number == task_id]

    async def until(self, task_id, state):
        async with asyncio.timeout(1000):
            while self.state(task_id) is not state:
                await self.manager.change_feed.wait_for_change(self.manager.change_feed.revision, 1)

    async def watch(self):
        original = self.manager.change_feed.announce

        def announce(task_id=None):
            if task_id is not None:
                state = self.manager.repository.find(task_id).state
                if (task_id, state) != (self.seen or [None])[-1]:
                    self.seen.append((task_id, state))
            original(task_id)

        self.manager.change_feed.announce = announce
        await self.manager.start()


@pytest.fixture
async def scene():
    scene = Scene(settle=0.0)
    await scene.watch()
    yield scene
    scene.store.is_full = False
    await scene.manager.close()
