"""The simulated servers: they can die at any instant, and report their executions."""

from __future__ import annotations

import asyncio

import srvgen
import taskrpc
from tests.simulation.disks import EffectDisk, File, TaskDisk
from tests.simulation.ledger import INSIDE
from tests.simulation.machine import CountingRobot
from tests.simulation.news import Announcer

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
GRACE = 2.0
"""Seconds that calls in flight get when a server drains."""
START_AGAIN = 0.4
"""Seconds after which a server that could not start is started again."""


class Server:
    """One life of a server; with a disk it also offers the services that need one.

    `strike(seconds)` kills it during its work after this time.
    """

    def __init__(self, name, ledger, chance, strike, around, disk=None):
        self.name = name
        self.stop = asyncio.Event()
        self._ledger = ledger
        self._chance = chance
        self._strike = strike
        self._around = around
        self._disk = disk
        self._tasks_file = None

    @property
    def is_ill(self) -> bool:
        """Whether its disk is usable only after a restart."""
        return self._tasks_file is not None and self._tasks_file.is_broken

    async def run(self):
        while not self.stop.is_set():
            self._ledger.note(f"{self.name} starts")
            try:
                await self._live()
            except (taskrpc.StoreError, taskrpc.OutcomeUnknown) as error:
                self._ledger.counts["failed starts"] += 1
                self._ledger.note(f"{self.name} cannot start: {error}")
                await asyncio.sleep(START_AGAIN)
        self._ledger.note(f"{self.name} ends")

    async def _live(self):
        accounts = self._around.accounts
        async with taskrpc.Node(
            "server", transport="memory", listen=self.name, accounts=accounts
        ) as node:
            self._offer(node)
            Announcer(node, self._ledger, self._chance)
            if self._disk is None:
                await self._until_told(node)
                return
            options = {"exactly_once": EffectDisk(self._file())}
            node.create_service(Add, "once", self._handle_once, **options)
            self._tasks_file = self._file()
            store = TaskDisk(self._tasks_file, self._ledger)
            robot = CountingRobot(self._disk, self._ledger, self._chance)
            clock = self._around.wall_clock
            async with taskrpc.TaskServer(node, robot, store, settle=0.02, wall_clock=clock):
                await self._until_told(node)

    def _offer(self, node):
        for kind, options in (
            ("plain", {}),
            ("repeatable", {"idempotent": True}),
            ("steer", {"role": taskrpc.Role.OPERATE}),
        ):
            node.create_service(Add, kind, self._handle, concurrency=4, join=True, **options)

    def _file(self):
        def strike(seconds):
            self._strike(self.name, seconds)

        return File(self._disk, self._chance, strike, self._ledger.counts)

    async def _until_told(self, node):
        await self.stop.wait()
        await node.drain(GRACE)

    async def _handle(self, request, response):
        call = taskrpc.current_call()
        latest = asyncio.get_running_loop().time() + (call.time_left() or 0.0)
        try:
            await asyncio.sleep(self._begin(request, call))
        except asyncio.CancelledError:
            self._ledger.stopped(request.a)
            raise
        self._ledger.finished(request.a, latest)
        if self._ledger.requests[request.a].fails:
            raise ValueError(INSIDE)
        response.sum = request.a + request.b
        return response

    async def _handle_once(self, request, response):
        await asyncio.sleep(self._begin(request, taskrpc.current_call()))
        if self._ledger.requests[request.a].fails:
            raise taskrpc.HandlerError("ABORTED", f"{request.a} fails")
        response.sum = request.a + request.b
        disk = self._disk.number
        return taskrpc.Effect(response, lambda: self._ledger.had_effect(request.a, disk))

    def _begin(self, request, call):
        """How many seconds the work takes."""
        seconds = self._chance.choice((0.0, 0.01, 0.3, 3.0)) * self._chance.random()
        self._ledger.started(request.a, self.name, self._ledger.now() + seconds)
        needed = taskrpc.Role.OPERATE if call.service == "/steer" else taskrpc.Role.SUBMIT
        if not self._around.accounts.might(call.principal, needed):
            self._ledger.broke("ran without the right", f"{request.a} for {call.principal}")
        return seconds
