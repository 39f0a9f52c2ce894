"""The simulated callers: they call everything, die, restart, and check the responses."""

from __future__ import annotations

import asyncio

import srvgen
import taskrpc
from tests.simulation.chance import LEASE
from tests.simulation.news import Listener
from tests.simulation.servers import Add

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
TYPES = {
    "plain": Add,
    "repeatable": Add,
    "once": Add,
    "submit": RobotTask,
    "steer": Add,
    "nowhere": Add,
}
NAMES = {"submit": "robot_task"}
AT_ONCE = ("plain", "repeatable", "steer", "nowhere")
"""Requests that are sent once unless the caller has a retry policy."""
DRAWN = (*TYPES, "plain", "once", "once", "submit", "submit")
LASTING = ("repeatable", "once", "submit")
"""Requests that must be answered in the end despite all network faults."""
AGAIN_WITHIN = 4.0
"""Seconds after which a caller that died asks no more for what it asked before: by then the
servers may have forgotten it."""


class Client:
    """One life of a caller: calls everything, several at a time, and reports to the ledger."""

    def __init__(self, name, token, ledger, chance, calm, accounts):
        self.name = name
        self.left = 0
        """Calls that it has not begun yet."""
        self._token = token
        self._ledger = ledger
        self._chance = chance
        self._calm = calm
        self._accounts = accounts
        self._open = {}
        self._named = []

    def died(self):
        """End this life; returns the requests that another life repeats, answered or not."""
        now = self._ledger.now()
        for request in self._open:
            self._ledger.abandoned(request)
        return [request for request in self._named if now - request.asked < AGAIN_WITHIN]

    async def run(self, calls, again=()):
        self.left = calls
        async with taskrpc.Node(
            "client", transport="memory", listen=self.name, token=self._token
        ) as node:
            clients = {
                kind: node.create_client(srv_type, NAMES.get(kind, kind))
                for kind, srv_type in TYPES.items()
            }
            account = self._token.partition(".")[0]
            listener = Listener(node, self.name, self._ledger, account, self._accounts)
            async with asyncio.TaskGroup() as group:
                for request in again:
                    self._ledger.counts["asked again"] += 1
                    group.create_task(self._ask_again(clients, request))
                while self.left:
                    self.left -= 1
                    group.create_task(self._call(clients))
                    is_long = self._chance.random() < 0.04
                    await asyncio.sleep(1.25 * LEASE if is_long else self._chance.expovariate(4))
                    if is_long:
                        self._ledger.note(f"{self.name} is back")
            await self._calm.wait()
            for kind in LASTING:
                request = self._asked(kind, 20.0, must_be_answered=True)
                await self._sent(clients, request, 20.0, taskrpc.RetryPolicy())
            await listener.hear_of_the_present()

    async def _call(self, clients):
        chance = self._chance
        kind = chance.choice(DRAWN)
        timeout = chance.choice((0.1, 1.0, 8.0)) * (0.1 + chance.random())
        policy = chance.choice((None, taskrpc.RetryPolicy(), taskrpc.RetryPolicy(attempts=3)))
        number = len(self._ledger.requests) + 1
        is_named = kind in ("once", "submit") and chance.random() < 0.6
        request = self._asked(
            kind,
            timeout,
            request_id=str(number) if is_named else "",
            is_sent_once=kind in AT_ONCE and policy is None,
        )
        if is_named:
            self._named.append(request)
        times = 2 if is_named and chance.random() < 0.5 else 1
        await asyncio.gather(*(self._sent(clients, request, timeout, policy) for _ in range(times)))

    async def _ask_again(self, clients, request):
        request.client = self.name
        timeout = 2.0
        request.deadline = self._ledger.now() + timeout
        self._ledger.note(f"ask again {request.number}")
        await self._sent(clients, request, timeout, taskrpc.RetryPolicy())

    async def _sent(self, clients, request, timeout, policy):
        request.senders += 1
        self._open[request] = self._open.get(request, 0) + 1
        call = asyncio.ensure_future(
            clients[request.kind].call(
                _message(request), timeout=timeout, retry=policy, request_id=request.request_id
            )
        )
        is_impatient = not request.must_be_answered and self._chance.random() < 0.1
        patience = timeout * self._chance.random() if is_impatient else None
        done, _ = await asyncio.wait({call}, timeout=patience)
        if not done:
            call.cancel()
        try:
            self._ledger.told(request, await call)
        except (taskrpc.TaskRpcError, asyncio.CancelledError) as error:
            self._ledger.told(request, error)
        self._open[request] -= 1
        if not self._open[request]:
            del self._open[request]

    def _asked(self, kind, timeout, **more):
        return self._ledger.asked(kind, self.name, timeout, **more)


def _message(request):
    if request.kind == "submit":
        priority = 1 + request.number * 7 % 10
        return RobotTask.Request(task_type="move", target=str(request.number), priority=priority)
    return Add.Request(a=request.number, b=request.number)
