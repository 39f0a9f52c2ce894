"""Brings a task manager back to its beginning for the next group of users, while it runs."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from taskrpc.robot.tasks.manager import TaskManager
from taskrpc.robot.tasks.model import RUNNING_KEY, Task

_CLIENT = "the reset"  # by which the tasks are cancelled, as their messages say


async def end_all(manager: TaskManager) -> Sequence[Task]:
    """Pause the queue, cancel all its tasks and the running one; return all ended tasks.

    Tasks that arrive meanwhile stay in the queue: they belong to the next group.

    Raises:
        StoreError: a task could not be stored; some tasks may be cancelled already.
    """
    known = [task.task_id for _, task, _ in manager.waiting(RUNNING_KEY)]
    await manager.pause()
    if running := manager.running:
        await manager.cancel(running.task_id, client=_CLIENT)
    await asyncio.gather(*(manager.cancel(task_id, client=_CLIENT) for task_id in known))
    interrupted = [*manager.repository.interrupted]
    await asyncio.gather(*(manager.drop(task_id, client=_CLIENT) for task_id in interrupted))
    return sorted(manager.repository.ended(), key=lambda task: task.task_id)


async def begin_again(manager: TaskManager) -> str:
    """Forget the ended tasks, put the robot to its start and resume the queue.

    Returns why the robot is not at its start, "" if it is. Raises StoreError.
    """
    await manager.repository.forget_ended()
    problem = manager.reset_robot()
    manager.update_estimates()
    response = await manager.resume()
    return problem or ("" if response.success else response.message)
