"""Clients, a task server that crashes and comes back, a network that breaks; and the truth."""

from __future__ import annotations

import asyncio
import random

import srvgen
import taskrpc
from taskrpc.attempts import Attempts
from taskrpc.deduplication import OnceDesk, Run
from taskrpc.tasks import TaskServer
from tests.simulation.process import Disk, Process, endpoint_of, task_factory
from tests.taskrpc.tasks.fakes import LineRobot

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
CLIENTS, CALLS = 3, 12
END = 60.0


class World:
    """One run of everything; `seed` decides all that is left to chance."""

    def __init__(self, seed, counts, say=lambda _: None):
        self.chance = random.Random(seed)
        self.counts = counts
        self.events = []
        self.told = {}  # target -> what its caller learned
        self.driven = []
        self.server = None
        self._say = say
        self._disk = Disk(self.chance, counts)
        self._names = 0
        self._over = False

    def note(self, what):
        """Write down what happened, and when."""
        line = f"{asyncio.get_running_loop().time():.6f} {what}"
        self.events.append(line)
        self._say(line)

    async def run(self):
        """Let it all happen, then look at what is left."""
        keeper = asyncio.ensure_future(self._keep_server())
        gremlin = asyncio.ensure_future(self._break_connections())
        async with asyncio.TaskGroup() as clients:
            for number in range(CLIENTS):
                clients.create_task(self._client(number))
        self._over = True
        await keeper
        gremlin.cancel()
        await asyncio.sleep(1)
        self._check((await self._disk.kept.load()).tasks)

    # The server's side

    async def _keep_server(self):
        while not self._over:
            self._names += 1
            token, process = f"server {self._names}", Process(f"server {self._names}")
            life = process.run(self._serve(process, token))
            await asyncio.sleep(self.chance.uniform(0.02, 0.6))
            if self.chance.random() < 0.75:
                self.note(f"{process.name} is killed")
                self.counts["crashes"] += 1
                process.kill(endpoint_of(token))
            else:
                self.note(f"{process.name} ends")
                self.counts["ends"] += 1
                life.cancel()
            await asyncio.wait({life})
            await asyncio.sleep(self.chance.choice((0.0, 0.1, 1.0)))

    async def _serve(self, process, token):
        robot = LineRobot(speed=30.0)
        robot.log = self.driven
        store = self._disk.opened_by(process)
        async with taskrpc.Node("robot", transport="memory", token=token) as node:
            server = TaskServer(node, robot, store, settle=0.0, wall_clock=self._wall_clock)
            try:
                await server.start()
                self.note(f"{process.name} takes tasks")
                await asyncio.Event().wait()
            finally:
                if not process.is_dead:
                    await node.drain(1.0)
                    await server.close()

    @staticmethod
    def _wall_clock():
        return 1_000_000.0 + asyncio.get_running_loop().time()

    # The network

    async def _break_connections(self):
        while True:
            await asyncio.sleep(self.chance.uniform(0.005, 0.15))
            ends = [
                connection.transport
                for number in range(CLIENTS)
                if (endpoint := endpoint_of(f"client {number}")) is not None
                for connection in endpoint._connections()
                if connection.transport is not None
            ]
            if not ends:
                continue
            pipe = self.chance.choice(ends)
            if self.chance.random() < 0.6:
                self.counts["drops"] += 1
                pipe.abort()
            else:
                self.counts["stalls"] += 1
                stalled = self.chance.choice((pipe, pipe.peer))
                stalled.pause_reading()
                again = self.chance.uniform(0.01, 1.0)
                asyncio.get_running_loop().call_later(again, stalled.resume_reading)

    # The clients' side

    async def _client(self, number):
        name = f"client {number}"
        async with taskrpc.Node("student", transport="memory", token=name) as node:
            client = node.create_client(RobotTask, "/robot_task")
            await client.wait_for_service(timeout=END)
            for each in range(CALLS):
                await asyncio.sleep(self.chance.uniform(0.0, 0.1))
                await self._call(client, f"{number}.{each + 1}")

    async def _call(self, client, target):
        timeout = self.chance.choice((0.05, 0.5, 5.0, 20.0))
        request = RobotTask.Request(task_type="move", target=target, priority=5)
        call = asyncio.ensure_future(
            client.call(request, timeout=timeout, retry=taskrpc.RetryPolicy())
        )
        if self.chance.random() < 0.15:
            asyncio.get_running_loop().call_later(self.chance.uniform(0, 0.1), call.cancel)
        loop = asyncio.get_running_loop()
        began = loop.time()
        try:
            learned = (await call).task_id
        except taskrpc.TaskRpcError as error:
            fate = {True: "not run", False: "run", None: "unknown"}[error.not_executed]
            self.counts[f"told {fate}"] += 1
            learned = fate
        except asyncio.CancelledError:
            learned = "cancelled"
        else:
            self.counts["accepted"] += 1
        self.counts["late"] += loop.time() - began > timeout + 0.1
        self.told[target] = learned
        self.note(f"{target}: {learned}")

    # The truth

    def _check(self, tasks):
        stored = {}
        for task in tasks:
            self.counts["doubled"] += task.target in stored
            stored[task.target] = task
        for target, learned in self.told.items():
            task = stored.get(target)
            if isinstance(learned, int):
                self.counts["lost"] += task is None
                self.counts["wrong number"] += task is not None and task.task_id != learned
            elif learned == "not run":
                self.counts["run after all"] += task is not None
        targets = [target for _, target in self.driven]
        self.counts["driven twice"] += len(targets) - len(set(targets))


class CountedWait:
    """Counts what the client and the server do about faults."""

    def __init__(self, counts):
        self._counts = counts
        self._before = Attempts._wait_after, Run.attach, OnceDesk._repeat

    def __enter__(self):
        counts, (wait, attach, repeat) = self._counts, self._before

        def waited(attempts, error):
            found = wait(attempts, error)
            counts["retries"] += found is not None
            return found

        def attached(run, call):
            counts["attaches"] += bool(run.callers)
            attach(run, call)

        def repeated(desk, call, completion):
            counts["answered again"] += 1
            repeat(desk, call, completion)

        Attempts._wait_after, Run.attach, OnceDesk._repeat = waited, attached, repeated

    def __exit__(self, *_):
        Attempts._wait_after, Run.attach, OnceDesk._repeat = self._before


def simulate(seed, counts, make_loop, say=lambda _: None):
    """Run one world; returns its events."""
    loop = make_loop()
    loop.set_task_factory(task_factory)
    world = World(seed, counts, say)
    try:
        with Chance(seed), CountedWait(counts):
            loop.run_until_complete(world.run())
    finally:
        _end(loop)
    return world.events


class Chance:
    """Puts one seed behind everything that the product draws."""

    def __init__(self, seed):
        self._source = random.Random(f"product {seed}")

    def __enter__(self):
        import os

        self._urandom, self._state = os.urandom, random.getstate()
        os.urandom = self._source.randbytes
        random.seed(self._source.random())

    def __exit__(self, *_):
        import os

        os.urandom = self._urandom
        random.setstate(self._state)


def _end(loop):
    left = asyncio.all_tasks(loop)
    for task in left:
        task.cancel()
    if left:
        loop.run_until_complete(asyncio.wait(left))
    loop.close()
