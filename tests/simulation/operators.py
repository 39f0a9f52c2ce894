"""The simulated operator: pauses the queue, and moves and cancels the callers' tasks."""

from __future__ import annotations

import asyncio

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
DRAWN = (*VERBS, "resume", "resume", "reprioritise", "reprioritise", "requeue", "requeue")

UNSTORED = "this could not be stored"
"""The part of a response that reports a change that was made and not stored."""


class Operator:
    """Gives orders, some concurrently, until the faults end; then resumes the queue."""

    def __init__(self, name, ledger, chance, calm):
        self.name = name
        self._ledger = ledger
        self._chance = chance
        self._calm = calm

    async def run(self):
        async with taskrpc.Node("operator", transport="memory", listen=self.name) as node:
            clients = {
                verb: node.create_client(srv_type, f"robot_task/{verb}")
                for verb, srv_type in TYPES.items()
            }
            async with asyncio.TaskGroup() as group:
                while not self._calm.is_set():
                    verb = self._chance.choice(DRAWN)
                    group.create_task(self._give(clients, verb, self._chance.uniform(0.2, 3)))
                    await asyncio.sleep(self._chance.expovariate(4))
            while await self._give(clients, "resume", 5.0) is not True:
                await asyncio.sleep(0.1)

    async def _give(self, clients, verb, timeout):
        """Carry out an order; returns whether it had an effect."""
        policy = self._chance.choice((None, taskrpc.RetryPolicy()))
        request = TYPES[verb].Request()
        task_id = priority = 0
        if hasattr(request, "task_id"):
            # Also one that is about to be submitted.
            newest = max((each.task_id for each in self._ledger.requests.values()), default=0)
            request.task_id = task_id = max(1, newest + 2 - self._chance.randrange(8))
        if hasattr(request, "resume"):
            request.resume = self._chance.random() < 0.5
        if hasattr(request, "priority"):
            request.priority = priority = self._chance.randint(1, 10)
        now = self._ledger.now
        order = self._ledger.orders.given(verb, task_id, priority, now())
        try:
            answer = await clients[verb].call(request, timeout=timeout, retry=policy)
            done = None if UNSTORED in answer.message else answer.success
        except taskrpc.TaskRpcError as error:
            done = False if error.not_executed else None
        self._ledger.orders.told(order, done, now())
        return done
