"""One simulated world from one seed: servers, clients, a network and a fate that breaks them."""

from __future__ import annotations

import asyncio
import contextvars
import hashlib
import random

from taskrpc.testing import FaultyNetwork
from tests.simulation.chance import only_chance
from tests.simulation.ledger import Ledger
from tests.simulation.machine import Disk
from tests.simulation.processes import SimulatedLoop
from tests.simulation.programs import Client, Server, ended

CLIENTS = 3
CALLS = 14
SECONDS = 6.0
"""For how long things break."""
QUIET = 25.0
"""For how long nothing does, so that what is still to happen happens."""


class World:
    """Starts everything, breaks it, heals it, and compares in the end."""

    def __init__(self, chance, ledger):
        self._chance = random.Random(chance.random())
        self._ledger = ledger
        self._loop = asyncio.get_running_loop()
        self._lives = 0
        self._disk = Disk()
        ledger.disks.append(self._disk)
        self._running = {}
        self._returning = set()
        self._context = contextvars.copy_context()
        self._calm_from = self._loop.time() + SECONDS

    async def live(self):
        chance = self._chance
        with FaultyNetwork(
            chance.randrange(2**32),
            delay=(0.0, chance.choice((0.0, 0.002, 0.05))),
            pieces=chance.choice((0, 0, 7, 60)),
            cut_after=chance.choice((0, 20_000, 3000)),
            refuse=chance.choice((0.0, 0.1)),
            dead_after=1.0,
        ) as network:
            self._network = network
            self._start("main")
            if chance.random() < 0.6:
                self._start("helper")
            clients = [self._start_client(number) for number in range(CLIENTS)]
            await self._break_things()
        await asyncio.wait(clients)
        await asyncio.sleep(QUIET)
        await self._end(clients)
        self._ledger.counts.update(network.happened)

    # Its fate

    async def _break_things(self):
        chance = self._chance
        while self._loop.time() < self._calm_from:
            await asyncio.sleep(chance.expovariate(2))
            what = chance.choice(
                (self._crash, self._crash, self._restart, self._partition, self._cut, self._heal)
            )
            if self._running:
                await what()
        if self._returning:
            await asyncio.wait(self._returning)

    async def _crash(self):
        await self._crash_of(self._which())

    async def _crash_of(self, which):
        process, _, server = self._running.pop(which)
        self._ledger.note(f"{server.name} crashes")
        self._loop.kill(process)
        self._network.crash(server.name)
        await self._start_again(which)

    def _strike(self, name, seconds):
        """Kill a server where it writes; from our own context, or we would die with it."""
        self._loop.call_later(seconds, self._struck, name, context=self._context)

    def _struck(self, name):
        running = [server.name for _, _, server in self._running.values()]
        if name in running and self._loop.time() < self._calm_from:
            self._ledger.counts["crashes in a write"] += 1
            self._returning.add(self._loop.create_task(self._crash_of("main")))

    async def _restart(self):
        which = self._which()
        _, task, server = self._running.pop(which)
        self._ledger.counts["restarts"] += 1
        server.stop.set()
        await asyncio.wait({task})
        task.result()
        await self._start_again(which)

    async def _start_again(self, which):
        await asyncio.sleep(self._chance.choice((0.01, 0.3, 1.5)) * self._chance.random())
        if which == "main" and self._chance.random() < 0.15:
            self._disk = Disk()
            self._ledger.disks.append(self._disk)
            self._ledger.counts["new stores"] += 1
        self._start(which)

    async def _partition(self):
        server = self._running[self._which()][2].name
        client = self._chance.randrange(CLIENTS)
        both = self._chance.random() < 0.5
        a, b = self._chance.choice(((server, f"client{client}"), (f"client{client}", server)))
        self._ledger.note(f"partition {a} {b} {both}")
        self._network.partition(a, b, both=both)
        self._ledger.counts["partitions"] += 1

    async def _cut(self):
        server = self._running[self._which()][2].name
        self._network.cut(server, f"client{self._chance.randrange(CLIENTS)}")

    async def _heal(self):
        self._network.heal()

    def _which(self):
        return self._chance.choice(tuple(self._running))

    # Its programs

    def _start(self, which):
        self._lives += 1
        disk = self._disk if which == "main" else None
        chance = random.Random(self._chance.random())
        server = Server(f"{which}{self._lives}", self._ledger, chance, self._strike, disk)
        process, task = self._loop.start(server.run())
        self._running[which] = process, task, server

    def _start_client(self, number):
        chance = random.Random(self._chance.random())
        client = Client(f"client{number}", self._ledger, chance, CALLS)
        _, task = self._loop.start(client.run())
        return task

    async def _end(self, clients):
        for task in clients:
            task.result()
        for _, task, server in self._running.values():
            server.stop.set()
            await ended(task)
        await asyncio.sleep(5)
        await self._ledger.compare()
        left = self._loop.tasks_of_the_living()
        timers = self._loop.timers_of_the_living()
        if left or timers:
            self._ledger.broke("left behind", f"{left} {timers}")


def simulate(seed, counts, tell=None):
    """Live one world and count what happened in it; returns the digest of all that did."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        loop = runner.get_loop()

        async def main():
            ledger = Ledger(counts, tell)
            with only_chance(seed, loop, counts) as chance:
                await World(chance, ledger).live()
            return hashlib.sha256("\n".join(ledger.lines).encode()).hexdigest()

        try:
            return runner.run(main())
        finally:
            loop.bury()
