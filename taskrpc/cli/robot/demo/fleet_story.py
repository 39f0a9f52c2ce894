"""The story of `taskrpc demo --fleet`: three robots share one queue, and one server is lost.

The same managers as on PostgreSQL run here with a database in memory, on virtual time. All times
are seconds since the story began.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import NamedTuple

from taskrpc.cli.robot.demo.story import Line
from taskrpc.errors import StoreError
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.fleet import FleetManager, FleetSettings, MemoryFleet, MemoryFleetStore
from taskrpc.robot.tasks import Task, TaskResponse, TaskState
from taskrpc.testing import VirtualTimeLoop

ROBOTS = {"robot_1": "", "robot_2": "move,report", "robot_3": "scan,move"}
"""Each robot, and its `--capabilities`."""


class Submit(NamedTuple):
    """A client submits a task at the server of a robot."""

    at: float
    client: str
    server: str
    task_type: str
    target: str
    priority: int


SCRIPT: Sequence[Submit] = (
    Submit(0.0, "client_1", "robot_1", "move", "warehouse", 8),
    Submit(0.0, "client_2", "robot_2", "scan", "area_a", 9),
    Submit(0.0, "client_3", "robot_3", "report", "central", 3),
    Submit(0.0, "client_1", "robot_2", "move", "station_1", 5),
    Submit(3.0, "client_2", "robot_3", "scan", "central", 4),
    Submit(4.0, "client_3", "robot_1", "move", "warehouse", 6),
    Submit(6.0, "client_2", "robot_2", "report", "dock", 10),
)
_LOST = "robot_2"
_LOST_AT = 5.0
_BACK_AT = 20.0
_OTHER = "robot_3"
_SETTLE = 0.1


class Performance(NamedTuple):
    """What happened."""

    lines: list[Line]
    tasks: list[Task]
    executions: dict[str, int]
    """How often each robot's `execute` was called."""


class _CountingRobot(KinematicRobot):
    """A simulated robot that counts its executions."""

    executions = 0

    async def execute(self, *arguments: object) -> dict[str, object]:
        self.executions += 1
        return await super().execute(*arguments)  # type: ignore[arg-type]


def perform() -> Performance:
    """Perform the story on virtual time, which takes a moment."""
    # What the servers log about the lost connection is part of the story, not a problem.
    logging.getLogger("taskrpc").addHandler(logging.NullHandler())
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(_perform())


async def _perform() -> Performance:
    return await _Story().perform()


def is_right(performance: Performance) -> bool:
    """Return whether every task has succeeded, and only the interrupted one ran again."""
    done = all(task.state is TaskState.SUCCEEDED for task in performance.tasks)
    return done and sum(performance.executions.values()) == len(performance.tasks) + 1


def summary(performance: Performance) -> list[str]:
    """Return what the fleet has done, as lines."""
    count = len(performance.tasks)
    by_robot = {
        name: [str(task.task_id) for task in performance.tasks if task.robot == name]
        for name in ROBOTS
    }
    lines = [f"{count} tasks, {len(ROBOTS)} robots, one queue:"]
    for name, task_ids in by_robot.items():
        lines.append(f"  {name} executed {' '.join(task_ids) or 'none'}")
    lines.append(f"{_LOST} was cut off: its task was interrupted, no task was lost or ran twice.")
    return lines


class _Story:
    """The servers, their database, and an observer of it."""

    def __init__(self) -> None:
        self._lines: list[Line] = []
        self._states: dict[int, TaskState] = {}
        self._interrupted = asyncio.Event()
        self._changed = asyncio.Event()
        loop = asyncio.get_running_loop()
        # Later than 0, which means "never" in a message.
        self._database = MemoryFleet(lambda: 1.0 + loop.time())
        self._observer = MemoryFleetStore(self._database)
        self._observer.listeners.append(self._look)
        self._robots = {name: _CountingRobot(default_world()) for name in ROBOTS}
        self._stores = {name: MemoryFleetStore(self._database) for name in ROBOTS}
        self._managers = {
            name: FleetManager(
                self._robots[name],
                self._stores[name],
                FleetSettings(name=name, capabilities=able, settle=_SETTLE),
            )
            for name, able in ROBOTS.items()
        }

    async def perform(self) -> Performance:
        for name, manager in self._managers.items():
            await manager.start()
            able = ROBOTS[name] or "everything"
            self._tell(name, f"joins the fleet; it is able to do: {able}")
        acting = [
            asyncio.create_task(work) for work in (self._submit(), self._lose(), self._decide())
        ]
        await asyncio.gather(*acting)
        while not all(task.state is TaskState.SUCCEEDED for task in self._tasks()):
            self._changed.clear()
            async with asyncio.timeout(600):
                await self._changed.wait()
        for manager in self._managers.values():
            await manager.close()
        executions = {name: robot.executions for name, robot in self._robots.items()}
        return Performance(self._lines, self._tasks(), executions)

    async def _submit(self) -> None:
        for act in SCRIPT:
            await _until(act.at)
            server = act.server
            request = f"{act.task_type} {act.target} {act.priority}"
            try:
                response = await self._submit_to(server, act)
            except StoreError as error:
                self._tell(act.client, f"{request} at {server}'s server -> {error}")
                server = _OTHER  # as a client with a retry policy does
                response = await self._submit_to(server, act)
            estimate = f"task {response.task_id}, done in {response.estimated_time:.1f} s"
            answer = f"{response.message} ({estimate})"
            self._tell(act.client, f"{request} at {server}'s server -> {answer}")

    async def _submit_to(self, server: str, act: Submit) -> TaskResponse:
        manager = self._managers[server]
        return await manager.submit(act.task_type, act.target, act.priority, client=act.client)

    async def _lose(self) -> None:
        await _until(_LOST_AT)
        self._stores[_LOST].is_cut_off = True
        self._tell("network", f"{_LOST} is cut off from the database")
        await _until(_BACK_AT)
        self._stores[_LOST].is_cut_off = False
        self._tell("network", f"{_LOST} is connected again")

    async def _decide(self) -> None:
        """Let the operator queue the interrupted task again."""
        await self._interrupted.wait()
        await asyncio.sleep(1.0)
        manager = self._managers["robot_1"]
        [task_id] = manager.store.state.interrupted
        response = await manager.requeue(task_id, resume=True)
        self._tell("operator", f"taskrpc task resume {task_id} -> {response.message}")

    def _look(self, task_ids: Sequence[int]) -> None:
        for task_id in task_ids:
            task = self._observer.state.tasks[task_id]
            if task.state is not self._states.get(task_id):
                self._states[task_id] = task.state
                self._tell_state(task)
        self._changed.set()

    def _tell_state(self, task: Task) -> None:
        if task.state is TaskState.RUNNING:
            work = f"{task.task_type} {task.target}"
            self._tell(task.robot, f"begins task {task.task_id}: {work} (priority {task.priority})")
        elif task.state is TaskState.INTERRUPTED:
            self._tell("fleet", f"task {task.task_id} is INTERRUPTED: {task.message}")
            self._interrupted.set()
        elif task.state.is_ended:
            self._tell(task.robot, f"task {task.task_id} {task.state.value}")

    def _tasks(self) -> list[Task]:
        return [self._observer.state.tasks[each] for each in sorted(self._observer.state.tasks)]

    def _tell(self, actor: str, text: str) -> None:
        self._lines.append(Line(asyncio.get_running_loop().time(), actor, text))


async def _until(at: float) -> None:
    await asyncio.sleep(at - asyncio.get_running_loop().time())
