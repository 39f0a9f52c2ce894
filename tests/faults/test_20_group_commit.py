"""Promise 20: durable acceptance is fast, because concurrent requests share one commit.

A store accepts tasks, 64 at a time, on a loop that also serves calls from another process.
"""

import asyncio
import contextlib
import itertools
import sys
import time
from pathlib import Path

import pytest

import srvgen
import taskrpc
from taskrpc.core.request_ids.ids import Completion
from taskrpc.core.storage.database import Database
from taskrpc.core.storage.writer import Writer
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from tests.faults.harness import Bug

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
IN_FLIGHT = 64
Trigger = srvgen.load("std_srvs/srv/Trigger")
CALLERS = """
import asyncio, srvgen, taskrpc

Trigger = srvgen.load("std_srvs/srv/Trigger")

async def main():
    async with taskrpc.Node("load") as node:
        client = node.create_client(Trigger, "work", timeout=60)
        async def call():
            while True:
                await client.call(Trigger.Request())
        await asyncio.gather(*(call() for _ in range(16)))

asyncio.run(main())
"""


@contextlib.asynccontextmanager
async def called(counts):
    """Serve calls on a loop during the block."""

    def work(request, response):
        counts["calls served"] += 1
        return response

    async with taskrpc.Node("server") as node:
        node.create_service(Trigger, "work", work)
        callers = await asyncio.create_subprocess_exec(sys.executable, "-c", CALLERS, cwd=ROOT)
        while not counts["calls served"]:
            await asyncio.sleep(0.01)
        try:
            yield
        finally:
            callers.kill()
            await callers.wait()


async def accept(store, seconds, counts):
    """Submit tasks for this many seconds."""
    numbers, end = itertools.count(1), time.monotonic() + seconds

    async def caller():
        while time.monotonic() < end:
            number = next(numbers)
            done = Completion("", bytes(16), number, number, bytes(16), b"ok", 0, 1.0)
            task = Task(
                task_id=number,
                task_type="move",
                target="warehouse",
                priority=5,
                arrival=number,
                submitted_at=1.0,
            )
            await store.apply([task], completion=done)
            counts["acknowledged"] += 1

    await asyncio.gather(*(caller() for _ in range(IN_FLIGHT)))


def makes_a_transaction_of_each(patch):
    everything = Writer._change_all

    def one_by_one(writer, changes):
        return [everything(writer, [change])[0] for change in changes]

    patch(Writer, "_change_all", one_by_one)


@pytest.fixture
def _count_transactions(counts, monkeypatch):
    do = Database._do

    def counted(self, transaction):
        counts["transactions"] += 1
        do(self, transaction)

    monkeypatch.setattr(Database, "_do", counted)


@pytest.mark.planted(Bug(makes_a_transaction_of_each, "waited for alone"))
@pytest.mark.usefixtures("_count_transactions")
async def test_many_tasks_are_accepted_in_one_transaction_beside_other_calls(
    tmp_path, counts, large
):
    seconds = 10.0 if large else 1.0
    store = SqliteStore(tmp_path / "tasks.db")
    await store.load()
    async with called(counts):
        await accept(store, seconds, counts)
    counts["lost"] += counts["acknowledged"] - len((await store.load()).tasks)
    await store.close()
    counts["acknowledged a second"] = round(counts["acknowledged"] / seconds)
    a_transaction = counts["acknowledged"] / counts["transactions"]
    counts["waited for alone"] += a_transaction <= IN_FLIGHT / 4
    counts["too slow"] += large and counts["acknowledged a second"] < 10_000
    counts.check("lost", "waited for alone", "too slow", happened=("calls served",))
    counts.require(calls_served=100, acknowledged=500)
