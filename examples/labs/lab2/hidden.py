"""Hidden checks of lab 2, for the lecturer: values at the limits, and many tasks at a time."""

import asyncio

from taskrpc.course.labs.checks.lab2 import TaskClient
from taskrpc.course.labs.lab import Check, NotMet

CALLS = 30


async def _refuses_what_is_similar(trial):
    client = await TaskClient.of(trial)
    for task in ("Move", "move ", "", "moves"):
        await client.refused(task, task, 3)
    most = int(client.values["MAX"])
    for priority in (0, -1, most + 1, 2**31 - 1, -(2**31)):
        await client.refused(str(priority), "scan", priority)
    for priority in (1, most):
        await client.accepted("scan", priority)


async def _uses_the_default(trial):
    client = await TaskClient.of(trial)
    await client.accepted("report")


async def _gives_each_task_a_number(trial):
    client = await TaskClient.of(trial)
    responses = await asyncio.gather(*(client.accepted("scan", 1) for _ in range(CALLS)))
    numbers = sorted(response.task_id for response in responses)
    if numbers != list(range(1, CALLS + 1)):
        raise NotMet(
            f"{CALLS} tasks at the same time to get the numbers 1 to {CALLS}",
            f"they got {numbers}",
            "each accepted task counts once",
        )


CHECKS = (
    Check("the server refuses what is only similar to a valid task", 2, _refuses_what_is_similar),
    Check("the server accepts a task with the default priority", 1, _uses_the_default),
    Check("each of many tasks gets a number of its own", 1, _gives_each_task_a_number),
)
