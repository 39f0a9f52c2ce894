"""Promise 12: SIGTERM drains: calls in flight are answered, later calls move to another server.

That is a second server of the same name, or a standby that continues the same tasks.
"""

import asyncio
import collections
import contextlib
import os
import random
import sqlite3

import pytest

import srvgen
import taskrpc
from taskrpc.core.storage.lock import FileInUse
from taskrpc.core.storage.writer import Writer
from taskrpc.node import Node
from taskrpc.robot.tasks.records import task_tables
from taskrpc.robot.tasks.records.store import Stored
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug
from tests.faults.programs import ADDER, TASK_SERVER, terminate

pytestmark = [
    pytest.mark.faults,
    pytest.mark.real_time,
    pytest.mark.skipif(os.name != "posix", reason="ends servers with SIGTERM, which is POSIX's"),
]

CLIENTS, AT_ONCE = 8, 6


def does_not_drain(patch):
    async def hurried(node, grace=0.0):
        pass

    patch(Node, "drain", hurried)


@pytest.mark.planted(Bug(does_not_drain, "errors that callers saw"))
async def test_callers_notice_nothing_of_draining_servers(counts, seed, large, programs):
    chance = random.Random(seed)
    over = asyncio.Event()
    in_flight = 0

    async def keep_calling(client, number):
        nonlocal in_flight
        while not over.is_set():
            number += 1
            in_flight += 1
            try:
                # No retries: a moved call was never started, and a started call is answered.
                answer = await client.call(ask(number, chance.randrange(40)))
                counts["wrong answers"] += answer.sum != number
                counts["answers"] += 1
            except taskrpc.TaskRpcError:
                counts["errors that callers saw"] += 1
            in_flight -= 1
            await asyncio.sleep(0.005)

    async with contextlib.AsyncExitStack() as stack:
        old = await programs.start(ADDER, "join")
        clients = []
        for number in range(CLIENTS):
            node = taskrpc.Node("client", token=f"c{number}")
            await stack.enter_async_context(node)
            clients.append(node.create_client(Add, "add"))
            assert await clients[-1].wait_for_service(10)
        calling = [
            asyncio.ensure_future(keep_calling(client, 1000 * number))
            for client in clients
            for number in range(AT_ONCE)
        ]
        for _ in range(1000 if large else 10):
            new = await programs.start(ADDER, "join")
            counts["in flight at a SIGTERM"] += in_flight
            counts["ended badly"] += await terminate(old) != 0
            counts["SIGTERMs"] += 1
            old = new
            if counts["errors that callers saw"]:
                break
        over.set()
        await asyncio.gather(*calling)
    counts.check(
        "errors that callers saw",
        "wrong answers",
        "ended badly",
        happened=("SIGTERMs", "answers"),
    )
    # About four fifths of the calls that these callers can have in flight, on an idle machine.
    counts.require(in_flight_at_a_SIGTERM=round(0.5 * CLIENTS * AT_ONCE * counts["SIGTERMs"]))


RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
PauseTasks = srvgen.load("taskrpc_interfaces/srv/PauseTasks")


def goes_on_without_the_tasks(patch):
    patch(task_tables, "load", lambda connection: Stored((), 1, bytes(16)))


def stands_by_for_ever(patch):
    async def claim(writer, waiting):
        waiting(FileInUse("planted"))
        await asyncio.Event().wait()

    patch(Writer, "claim", claim)


LOAD = 24
"""Responses between two SIGTERMs."""


class Relay:
    """Task servers of one file, each of which continues where the one before it was stopped."""

    def __init__(self, folder, programs, counts, chance, patience):
        self.patience = patience
        self.db, self.programs, self.counts = folder / "tasks.db", programs, counts
        self.chance = chance
        self.told = {}  # target -> task_id
        self.in_flight = 0
        self.over = asyncio.Event()

    async def start(self, *options):
        """A server; its queue is paused and stays paused."""
        limit = ["--queue-limit", "1000000"]
        options = ["--db", str(self.db), *limit, "--log-level", "error", *options]
        return await self.programs.start(
            TASK_SERVER, *options, ready="taskrpc-server", name="server.py"
        )

    async def stand_by(self):
        """A server that waits for the file, or takes it at once if no other server has it."""
        return await self.start("--standby")

    async def run(self, rounds):
        running = await self.start()
        async with taskrpc.Node("users") as node:
            client = node.create_client(PauseTasks, "/robot_task/pause")
            await client.call(PauseTasks.Request(), retry=taskrpc.RetryPolicy())
            next_one = await self.stand_by()
            async with asyncio.TaskGroup() as callers:
                for each in range(CLIENTS):
                    callers.create_task(self.keep_submitting(node, each))
                running, next_one = await self.hand_on(rounds, running, next_one)
                self.over.set()
        self.counts["ended badly"] += await terminate(next_one) != 0
        self.counts["ended badly"] += await terminate(running) != 0

    async def hand_on(self, rounds, running, next_one):
        for _ in range(rounds):
            await self.under_load()
            self.counts["in flight at a SIGTERM"] += self.in_flight
            self.counts["SIGTERMs"] += 1
            # The next standby starts already: one of two standbys takes over.
            code, after = await asyncio.gather(terminate(running), self.stand_by())
            self.counts["ended badly"] += code != 0
            running, next_one = next_one, after
            if self.counts["errors that callers saw"]:
                break
        return running, next_one

    async def under_load(self):
        """Return at a random moment while the server accepts tasks."""
        least = self.counts["answers"] + LOAD
        while self.counts["answers"] < least and not self.counts["errors that callers saw"]:
            await asyncio.sleep(0.002)
        await asyncio.sleep(self.chance.uniform(0, 0.02))

    async def keep_submitting(self, node, number):
        # With a retry policy a client waits for a server; without one the call fails at once.
        retry = taskrpc.RetryPolicy()
        client = node.create_client(RobotTask, "/robot_task", timeout=self.patience, retry=retry)
        each = 0
        while not self.over.is_set():
            each += 1
            target = f"{1 + number / 10:g},{1 + each / 100000:.5f}"
            request = RobotTask.Request(task_type="move", target=target, priority=5)
            self.in_flight += 1
            try:
                answer = await client.call(request)
                assert answer.success, answer.message
                self.told[target] = answer.task_id
                self.counts["answers"] += 1
            except taskrpc.TaskRpcError:
                self.counts["errors that callers saw"] += 1
            self.in_flight -= 1
            await asyncio.sleep(0.002)

    def judge(self):
        with contextlib.closing(sqlite3.connect(self.db)) as file:
            rows = file.execute("SELECT json_extract(record, '$.target') FROM task").fetchall()
        stored = collections.Counter(target for (target,) in rows)
        self.counts["lost"] = sum(not stored[target] for target in self.told)
        self.counts["doubled"] = sum(count > 1 for count in stored.values())
        numbers = collections.Counter(self.told.values())
        self.counts["one number for two"] = sum(count > 1 for count in numbers.values())


@pytest.mark.planted(
    Bug(goes_on_without_the_tasks, "one number for two"),
    Bug(stands_by_for_ever, "errors that callers saw"),
)
async def test_callers_notice_nothing_when_tasks_move_to_the_next_server(
    counts, seed, large, bug, programs, tmp_path
):
    # A few rounds for each store: reading a growing store would take most of the time.
    rounds, stores = (50, 20) if large else (10 if bug is None else 3, 1)
    chance, patience = random.Random(seed), 10 if bug is None else 3
    for number in range(stores):
        (folder := tmp_path / f"store{number}").mkdir()
        relay = Relay(folder, programs, counts, chance, patience)
        await relay.run(rounds)
        relay.judge()
        counts.check(
            "errors that callers saw",
            "lost",
            "doubled",
            "one number for two",
            "ended badly",
            happened=("SIGTERMs", "answers", "in flight at a SIGTERM"),
        )
