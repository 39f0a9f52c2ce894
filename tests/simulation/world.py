"""One simulation from one seed: servers, clients, a network, and faults in all of them."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import hashlib
import random

from msgspec.structs import replace

from taskrpc import Account, Role
from taskrpc.testing import FaultyNetwork
from tests.simulation import servers
from tests.simulation.chance import only_chance
from tests.simulation.clients import Client
from tests.simulation.disks import Disk
from tests.simulation.ledger import LATE, Ledger
from tests.simulation.machine import GRACE, LEAPS, ChangingAccounts, WallClock
from tests.simulation.operators import Operator
from tests.simulation.processes import SimulatedLoop
from tests.simulation.servers import Server

ROLES = (Role.SUBMIT, Role.SUBMIT, Role.OPERATE)
"""Of the clients."""
CALLS = 10
SECONDS = 6.0
"""Seconds with faults."""
QUIET = 15.0
"""Seconds without faults, in which all pending work ends."""


class World:
    """Starts everything, injects faults, ends them, and compares at the end."""

    def __init__(self, chance, ledger, wall_clock):
        self.wall_clock = wall_clock
        self.accounts = ChangingAccounts(
            Account(f"user{number}", f"secret-of-user-{number}", role)
            for number, role in enumerate(ROLES)
        )
        self._given = list(self.accounts)
        self._chance = random.Random(chance.random())
        self._ledger = ledger
        self._loop = asyncio.get_running_loop()
        self._lives = 0
        self._new_disk()
        self._running = {}
        self._clients = {}
        self._returning = set()
        self._partitioned = set()
        self._calm = asyncio.Event()
        self._context = contextvars.copy_context()
        self._calm_from = self._loop.time() + SECONDS

    async def live(self):
        chance = self._chance
        with FaultyNetwork(
            chance.randrange(2**32),
            delay=(0.0, chance.choice((0.0, 0.002, 0.05))),
            pieces=chance.choice((0, 0, 20, 60)),
            cut_after=chance.choice((0, 20_000, 3000)),
            refuse=chance.choice((0.0, 0.1)),
            dead_after=1.0,
        ) as network:
            self._network = network
            self._ledger.network_happened = network.happened
            self._start("main")
            if chance.random() < 0.6:
                self._start("helper")
            for number in range(len(ROLES)):
                self._start_client(number, CALLS)
            operator = Operator("operator", ledger := self._ledger, self._own_chance(), self._calm)
            _, operating = self._loop.start(operator.run())
            await self._break_things()
            await self._calm_down()
        callers = [task for _, task, _ in self._clients.values()]
        await asyncio.wait([*callers, operating])
        await asyncio.sleep(QUIET)
        await self._end([*callers, operating])
        ledger.counts.update(network.happened)

    # Its fate

    async def _break_things(self):
        fates = (
            *(self._crash, self._crash, self._restart, self._partition, self._cut, self._heal),
            *(self._fill, self._change_account, self._leap, self._crash_client, self._heal),
        )
        while self._loop.time() < self._calm_from:
            await asyncio.sleep(self._chance.expovariate(2.5))
            if self._running:
                await self._chance.choice(fates)()

    async def _calm_down(self):
        while self._returning:
            await asyncio.wait(self._returning)
        await self._heal()
        self._disk.ails = False
        await asyncio.sleep(GRACE)
        main = self._running["main"][2]
        if main.is_ill:
            await self._restart_of("main")
        self._ledger.note("calm")
        self._calm.set()

    async def _crash(self):
        await self._crash_of(self._which())

    async def _crash_of(self, which):
        process, _, server = self._running.pop(which)
        self._ledger.note(f"{server.name} crashes")
        self._ledger.crashed(server.name, self._who_can_hear(server.name))
        self._loop.kill(process)
        self._network.crash(server.name)
        await self._start_again(which)

    def _strike(self, name, seconds):
        """Kill a server during a write, from the simulation's context, which must survive."""
        self._loop.call_later(seconds, self._struck, name, context=self._context)

    def _struck(self, name):
        running = [server.name for _, _, server in self._running.values()]
        if name in running and self._loop.time() < self._calm_from:
            self._ledger.counts["crashes in a write"] += 1
            self._later(self._crash_of("main"))

    def _later(self, coroutine):
        task = self._loop.create_task(coroutine)
        self._returning.add(task)
        task.add_done_callback(self._returning.discard)

    async def _restart(self):
        self._ledger.counts["restarts"] += 1
        await self._restart_of(self._which())

    async def _restart_of(self, which):
        _, task, server = self._running.pop(which)
        if not self._partitioned:
            self._ledger.drains(server.name, self._loop.time() + servers.GRACE - LATE)
        server.stop.set()
        await asyncio.wait({task})
        task.result()
        await self._start_again(which)

    async def _start_again(self, which):
        await asyncio.sleep(self._chance.choice((0.01, 0.3, 1.5)) * self._chance.random())
        if which == "main" and self._disk.ails and self._chance.random() < 0.15:
            self._new_disk()
            self._ledger.counts["new stores"] += 1
        self._start(which)

    async def _partition(self):
        server, client = self._server_and_client()
        both = self._chance.random() < 0.5
        a, b = self._chance.choice(((server, client), (client, server)))
        self._ledger.note(f"partition {a} {b} {both}")
        self._ledger.troubled()
        self._partitioned.add(frozenset((a, b)))
        self._network.partition(a, b, both=both)
        self._ledger.counts["partitions"] += 1

    async def _cut(self):
        self._ledger.troubled()
        self._network.cut(*self._server_and_client())

    async def _heal(self):
        """End the faults of the network, the disks and the accounts."""
        self._ledger.troubled()
        self._partitioned.clear()
        self._network.heal()
        self._disk.is_full = False
        for account in self._given:
            if self.accounts.find(account.name, self.wall_clock()) is not account:
                self.accounts.change(account)

    async def _fill(self):
        self._ledger.note("the disk is full")
        self._ledger.counts["full disks"] += 1
        self._disk.is_full = True

    async def _change_account(self):
        account = self._chance.choice(self._given)
        if self._chance.random() < 0.5:
            changed = replace(account, revoked=True)
            self._ledger.counts["revocations"] += 1
        else:
            role = self._chance.choice((Role.OBSERVE, Role.SUBMIT, Role.OPERATE))
            changed = replace(account, role=role)
            self._ledger.counts["changes of role"] += role is not account.role
        self._ledger.note(f"now {changed}")
        self._ledger.account_changed()
        self.accounts.change(changed)

    async def _leap(self):
        seconds = self._chance.choice(LEAPS)
        self._ledger.note(f"the clock leaps by {seconds}")
        self._ledger.counts["leaps of the clock"] += 1
        self.wall_clock.leap(seconds)

    async def _crash_client(self):
        number = self._chance.randrange(len(ROLES))
        process, task, client = self._clients[number]
        if task.done():
            return
        self._ledger.note(f"{client.name} crashes")
        self._ledger.counts["crashes of clients"] += 1
        self._ledger.troubled()
        self._loop.kill(process)
        self._network.crash(client.name)
        if self._chance.random() < 0.5:
            await self._leap()
        await asyncio.sleep(self._chance.choice((0.01, 0.3, 1.5)) * self._chance.random())
        self._start_client(number, client.left, client.died())

    def _which(self):
        return self._chance.choice(tuple(self._running))

    def _server_and_client(self):
        client = self._clients[self._chance.randrange(len(ROLES))][2]
        return self._running[self._which()][2].name, client.name

    def _who_can_hear(self, server):
        names = (client.name for _, _, client in self._clients.values())
        return {name for name in names if frozenset((name, server)) not in self._partitioned}

    # Its programs

    def _start(self, which):
        self._lives += 1
        disk = self._disk if which == "main" else None
        chance = self._own_chance()
        name = f"{which}{self._lives}"
        server = Server(name, self._ledger, chance, self._strike, self, disk)
        process, task = self._loop.start(server.run())
        self._running[which] = process, task, server

    def _start_client(self, number, calls, again=()):
        self._lives += 1
        token = self._given[number].token
        name = f"client{number}.{self._lives}"
        ledger, chance = self._ledger, self._own_chance()
        client = Client(name, token, ledger, chance, self._calm, self.accounts)
        process, task = self._loop.start(client.run(calls, again))
        self._clients[number] = process, task, client

    def _own_chance(self):
        return random.Random(self._chance.random())

    def _new_disk(self):
        self._disk = Disk(len(self._ledger.disks), self._ledger)
        self._ledger.disks.append(self._disk)

    async def _end(self, callers):
        for task in callers:
            task.result()
        for _, task, server in self._running.values():
            server.stop.set()
            with contextlib.suppress(asyncio.CancelledError):  # wait for its end, whatever it is
                await task
        await asyncio.sleep(5)
        await self._ledger.compare()
        left = self._loop.tasks_of_the_living()
        timers = self._loop.timers_of_the_living()
        if left or timers:
            self._ledger.broke("left behind", f"{left} {timers}")


def simulate(seed, counts, tell=None):
    """Run one simulation and count its events; returns a digest of all events."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        loop = runner.get_loop()

        async def main():
            ledger = Ledger(counts, tell)
            wall_clock = WallClock(loop)
            with only_chance(seed, wall_clock, counts) as chance:
                await World(chance, ledger, wall_clock).live()
            return hashlib.sha256("\n".join(ledger.lines).encode()).hexdigest()

        try:
            return runner.run(main())
        finally:
            loop.bury()
