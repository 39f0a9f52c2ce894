"""The operator: it pauses the queue, and moves and cancels the callers' tasks."""

import asyncio
import itertools
import random

from moments import RECOVERED
from records import now, record

import srvgen
import taskrpc

VERBS = {
    "cancel": "CancelTask",
    "drop": "DropTask",
    "pause": "PauseTasks",
    "resume": "ResumeTasks",
    "reprioritise": "ReprioritiseTask",
    "requeue": "RequeueTask",
    "stop": "StopRobot",
}
TYPES = {verb: srvgen.load(f"taskrpc_interfaces/srv/{name}") for verb, name in VERBS.items()}
RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
KINDS = (*VERBS, "resume", "resume", "reprioritise", "reprioritise", "requeue", "requeue")
UNSTORED = "this could not be stored"
"""The part of a response that reports a change that was made and not stored."""


class Operator:
    """Gives orders, some concurrently, until the faults end; then resumes the queue."""

    def __init__(self, node):
        self._clients = {
            verb: node.create_client(srv_type, f"robot_task/{verb}")
            for verb, srv_type in TYPES.items()
        }
        self._newest = 1
        """The highest number of a task that the operator knows."""
        self._numbers = itertools.count(1)

    async def run(self):
        async with asyncio.TaskGroup() as group:
            while now() < RECOVERED - 3.0:
                verb = random.choice(KINDS)
                group.create_task(self._give(verb, random.uniform(0.2, 3.0)))
                await asyncio.sleep(random.expovariate(3))
        while await self._give("resume", 5.0) is not True:
            await asyncio.sleep(0.1)

    async def _give(self, verb, timeout):
        """Carry out an order; returns whether it had an effect, None if that is unknown."""
        policy = random.choice((None, taskrpc.RetryPolicy()))
        request = TYPES[verb].Request()
        task_id = priority = 0
        if hasattr(request, "task_id"):
            # Also one that is about to be submitted.
            request.task_id = task_id = max(1, self._newest + 2 - random.randrange(8))
        if hasattr(request, "resume"):
            request.resume = random.random() < 0.5
        if hasattr(request, "priority"):
            request.priority = priority = random.randint(1, 10)
        number = next(self._numbers)
        record("order", number, verb, task_id, priority)
        try:
            answer = await self._clients[verb].call(request, timeout=timeout, retry=policy)
            done = None if UNSTORED in answer.message else answer.success
            if done and task_id:
                self._newest = max(self._newest, task_id + 1)
        except taskrpc.TaskRpcError as error:
            done = False if error.not_executed else None
        record("order ended", number, done)
        return done


async def main():
    async with taskrpc.Node("operator", keepalive="robot") as node:
        await Operator(node).run()


asyncio.run(main())
