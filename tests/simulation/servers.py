"""The simulated programs: servers that can die at any instant, clients that compare."""

from __future__ import annotations

import asyncio
import contextlib

import srvgen
import taskrpc
from tests.simulation.chance import LEASE
from tests.simulation.machine import WALL, Arm, CountingRobot, EffectDisk, TaskDisk

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
TYPES = {"plain": Add, "repeatable": Add, "once": Add, "submit": RobotTask}
NAMES = {"submit": "robot_task"}


class Server:
    """One life of a server; with a disk it offers what needs one too.

    `strike(seconds)` ends it in the midst of what it does then.
    """

    def __init__(self, name, ledger, chance, strike, disk=None):
        self.name = name
        self.stop = asyncio.Event()
        self._ledger = ledger
        self._chance = chance
        self._strike = strike
        self._disk = disk

    async def run(self):
        self._ledger.note(f"{self.name} starts")
        async with taskrpc.Node("server", transport="memory", listen=self.name) as node:
            for kind, options in (("plain", {}), ("repeatable", {"idempotent": True})):
                node.create_service(Add, kind, self._handle, concurrency=4, join=True, **options)
            if self._disk is None:
                await self._until_told(node)
                return
            arm = Arm(self._disk, self._chance, lambda seconds: self._strike(self.name, seconds))
            node.create_service(Add, "once", self._handle_once, exactly_once=EffectDisk(arm))
            robot, store = CountingRobot(self._ledger, self._chance), TaskDisk(arm, self._ledger)
            loop = asyncio.get_running_loop()
            tasks = taskrpc.TaskServer(
                node, robot, store, settle=0.02, wall_clock=lambda: WALL + loop.time()
            )
            async with tasks:
                await self._until_told(node)

    async def _until_told(self, node):
        await self.stop.wait()
        await node.drain(2)
        self._ledger.note(f"{self.name} ends")

    async def _handle(self, request, response):
        loop = asyncio.get_running_loop()
        latest = loop.time() + (taskrpc.current_call().time_left() or 0.0)
        self._ledger.started(request.a)
        await self._work()
        self._ledger.finished(request.a, latest)
        response.sum = request.a + request.b
        return response

    async def _handle_once(self, request, response):
        self._ledger.note(f"run {request.a}")
        await self._work()
        response.sum = request.a + request.b
        return taskrpc.Effect(response, lambda: self._ledger.had_effect(request.a))

    async def _work(self):
        await asyncio.sleep(self._chance.choice((0.0, 0.01, 0.3, 3.0)) * self._chance.random())


class Client:
    """Calls everything, several at a time, and tells the ledger what it was told."""

    def __init__(self, name, ledger, chance, calls):
        self.name = name
        self._ledger = ledger
        self._chance = chance
        self._calls = calls

    async def run(self):
        async with taskrpc.Node("client", transport="memory", listen=self.name) as node:
            clients = {
                kind: node.create_client(srv_type, NAMES.get(kind, kind))
                for kind, srv_type in TYPES.items()
            }
            async with asyncio.TaskGroup() as group:
                for _ in range(self._calls):
                    group.create_task(self._call(clients))
                    is_long = self._chance.random() < 0.04
                    await asyncio.sleep(2 * LEASE if is_long else self._chance.expovariate(4))

    async def _call(self, clients):
        chance = self._chance
        kind = chance.choice(tuple(TYPES))
        timeout = chance.choice((0.1, 1.0, 8.0)) * (0.1 + chance.random())
        request = self._ledger.asked(kind, timeout)
        policy = chance.choice((None, taskrpc.RetryPolicy(), taskrpc.RetryPolicy(attempts=3)))
        if kind == "once" and chance.random() < 0.3:
            twice = [
                self._sent(clients, request, timeout, policy, str(request.number)) for _ in range(2)
            ]
            await asyncio.gather(*twice)
        else:
            await self._sent(clients, request, timeout, policy, "")

    async def _sent(self, clients, request, timeout, policy, request_id):
        call = asyncio.ensure_future(
            clients[request.kind].call(
                _message(request), timeout=timeout, retry=policy, request_id=request_id
            )
        )
        patience = timeout * self._chance.random() if self._chance.random() < 0.1 else None
        done, _ = await asyncio.wait({call}, timeout=patience)
        if not done:
            call.cancel()
        try:
            self._ledger.told(request, await call)
        except taskrpc.TaskRpcError as error:
            self._ledger.told(request, error)
        except asyncio.CancelledError as error:
            self._ledger.told(request, error)


def _message(request):
    if request.kind == "submit":
        priority = 1 + request.number * 7 % 10
        return RobotTask.Request(task_type="move", target=str(request.number), priority=priority)
    return Add.Request(a=request.number, b=request.number)


async def ended(task):
    """Wait for the end of a process, however it ends."""
    with contextlib.suppress(asyncio.CancelledError):
        await task
