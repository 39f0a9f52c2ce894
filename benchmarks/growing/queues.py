"""A task queue of many tasks, by itself and behind its manager, which stores and announces."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Callable
from itertools import islice

from benchmarks.growing import timing
from benchmarks.growing.memory import memory_each
from benchmarks.harness import usage
from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.manager import TaskManager, TaskSettings
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.queue.task_queue import TaskQueue
from taskrpc.robot.tasks.records.store import MemoryStore
from taskrpc.robot.tasks.services.pages import PAGE, page

_USED = 1000
"""Tasks that are cancelled, moved and run, at most, each."""
_FULL_PAGES = 10 * PAGE
"""Tasks; with fewer, most pages that begin somewhere in the queue are shorter than others."""
_HOME = Pose(0.0, 0.0, 0.0)


async def sample(size: int, seconds: float) -> dict[str, float]:
    """The queue and its manager with `size` tasks; `seconds` has no meaning here."""
    logging.disable()
    found = {**await _queue(size), **await _manager(size)}
    if size < _FULL_PAGES:
        found["queue_page"] = found["page"] = 0.0
    return found


class InstantRobot:
    """Drives along a line, and is there at once."""

    speed = 1.0
    task_types = ("move",)

    def plan(self, task_type: str, target: str, start: Pose) -> Plan:
        x = float(target)
        return Plan(abs(x - start.x) + 1.0, Pose(x, 0.0, 0.0))

    def pose(self) -> Pose:
        return _HOME

    def remaining(self) -> float:
        return 0.0

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def stop(self) -> None: ...

    async def execute(
        self, task_type: str, target: str, report: Callable[[float], None]
    ) -> dict[str, object]:
        return {}


async def _queue(size: int) -> dict[str, float]:
    chance = random.Random(1)
    robot = InstantRobot()
    queue = TaskQueue(lambda task, start: robot.plan("move", task.target, start), _HOME)
    tasks = [_task(number, chance) for number in range(1, size + 1)]
    found = {"queue_put": timing.microseconds(queue.put, tasks)}
    some = chance.sample(tasks, min(size // 2, _USED))
    found["queue_page"] = timing.microseconds(
        lambda task: list(islice(queue.ordered(task.order_key), PAGE)), some[:50]
    )
    found["queue_rerank"] = timing.microseconds(
        lambda task: queue.reprioritise(task.task_id, chance.randint(1, 10)), some
    )
    found["queue_remove"] = timing.microseconds(lambda task: queue.remove(task.task_id), some)

    async def pop(_: Task) -> None:
        queue.begin(await queue.get())

    found["queue_pop"] = await timing.microseconds_async(pop, some)
    return found


async def _manager(size: int) -> dict[str, float]:
    chance = random.Random(2)
    before = usage.memory()
    manager = TaskManager(InstantRobot(), MemoryStore(), TaskSettings(queue_limit=size, settle=0.0))
    await manager.start()
    await manager.pause()

    async def submit(_: int) -> None:
        await manager.submit("move", str(chance.randrange(100)), chance.randint(1, 10))

    found = {"submit": await timing.microseconds_async(submit, list(range(size)))}
    found["task_memory"] = memory_each(usage.memory() - before, size)
    some = chance.sample(range(1, size + 1), min(size // 2, _USED))
    cursors = _cursors(manager, some)
    found["page"] = timing.microseconds(lambda cursor: page(manager, cursor), cursors)
    found["reprioritise"] = await timing.microseconds_async(
        lambda task_id: manager.reprioritise(task_id, chance.randint(1, 10)), some
    )
    found["cancel"] = await timing.microseconds_async(manager.cancel, some)
    found["run"] = await _run_some(manager, len(some))
    await manager.close()
    return found


def _cursors(manager: TaskManager, task_ids: list[int]) -> list[str]:
    """Where pages begin, all over the queue."""
    keys = [task.order_key for task_id in task_ids[:50] if (task := manager.queue.find(task_id))]
    return [f"w{key[0]}:{key[1]}" for key in keys]


async def _run_some(manager: TaskManager, count: int) -> float:
    left = len(manager.queue) - count
    loop = asyncio.get_running_loop()
    began = loop.time()
    await manager.resume()
    while len(manager.queue) > left:  # noqa: ASYNC110 - nothing may slow the worker down
        await asyncio.sleep(0)
    return (loop.time() - began) / count * 1e6


def _task(number: int, chance: random.Random) -> Task:
    return Task(
        task_id=number,
        task_type="move",
        target=str(chance.randrange(100)),
        priority=chance.randint(1, 10),
        arrival=number,
        submitted_at=0.0,
    )
