"""Promise 26, for commits whose outcome stays unknown: what is acknowledged is in the database."""

import asyncio
import random

import pytest

import srvgen
import taskrpc
from taskrpc.errors import OutcomeUnknown, StoreError
from tests.faults.harness import Bug
from tests.faults.postgres_proxy import CUT, SHUT_DOWN, SWALLOW, PostgresProxy
from tests.faults.programs import TASK_SERVER, kill
from tests.robot.fleet.fakes import task

pytest.importorskip("psycopg")

from taskrpc.robot.fleet.postgres import connection as postgres_connection
from taskrpc.robot.fleet.postgres import store as postgres_store
from taskrpc.robot.fleet.postgres.store import PostgresStore

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")

PLANS = [(CUT, True, SWALLOW), (SWALLOW, True, SWALLOW), (CUT, True, CUT), (SHUT_DOWN, False, CUT)]
"""The fault of a commit, whether the database is then away, and the fault of the next commit."""


def reuses_the_number_of_an_unknown_commit(patch):
    original = PostgresStore._took_effect

    async def took_effect(store, uncertain, deadline):
        try:
            return await original(store, uncertain, deadline)
        except OutcomeUnknown:
            store._batch -= 1
            raise

    patch(PostgresStore, "_took_effect", took_effect)


def takes_the_end_of_a_session_for_an_error_of_a_statement(patch):
    def is_lost(connection, error):
        return connection.closed or connection.broken or isinstance(error, TimeoutError)

    for module in (postgres_connection, postgres_store):
        patch(module, "is_lost", is_lost)


@pytest.mark.planted(
    Bug(reuses_the_number_of_an_unknown_commit, breaks="acknowledged, not stored"),
    Bug(takes_the_end_of_a_session_for_an_error_of_a_statement, breaks="refused, but stored"),
)
async def test_acknowledged_tasks_are_stored_after_a_commit_of_unknown_outcome(
    postgres_url, shared_cluster, counts, seed, large, monkeypatch
):
    monkeypatch.setattr(postgres_store, "PATIENCE", 0.1)  # seconds
    monkeypatch.setattr(postgres_store, "_RETRY_AFTER", 0.02)
    chance = random.Random(seed)
    plans = [*PLANS, *chance.choices(PLANS, k=60 if large else 4)]
    async with PostgresProxy(shared_cluster.port) as proxy:
        url = postgres_url.replace(f":{shared_cluster.port}/", f":{proxy.port}/")
        store = PostgresStore(url, listen=False)
        results = {}

        async def submit(number):
            try:
                await store.apply([task(number)])
                results[number] = "acknowledged"
            except StoreError:
                results[number] = "refused"
            except OutcomeUnknown:
                results[number] = "unknown"

        for number, (fault, away, next_fault) in enumerate(plans):
            await submit(3 * number + 1)
            proxy.arm(fault, away=away)
            await submit(3 * number + 2)
            proxy.is_away = False
            proxy.arm(next_fault)
            monkeypatch.setattr(postgres_store, "PATIENCE", 10.0)  # only the fault can end it
            await submit(3 * number + 3)
            monkeypatch.setattr(postgres_store, "PATIENCE", 0.1)
            counts["faults"] += not proxy.is_armed
        await store.close()
    observer = PostgresStore(postgres_url, listen=False)
    stored = {each.task_id for each in (await observer.load()).tasks}
    await observer.close()
    for number, result in results.items():
        counts[result] += 1
        counts["acknowledged, not stored"] += result == "acknowledged" and number not in stored
        counts["refused, but stored"] += result == "refused" and number in stored
    counts.check("acknowledged, not stored", "refused, but stored", happened=("unknown", "faults"))
    counts.require(faults=len(plans), acknowledged=2 * len(plans))


@pytest.mark.planted(Bug(reuses_the_number_of_an_unknown_commit, breaks="acknowledged, not stored"))
async def test_server_acknowledges_only_stored_tasks_after_a_database_was_away(
    postgres_url, shared_cluster, programs, counts
):
    """With the real times: the database is away for 12 s, longer than the server waits."""
    async with PostgresProxy(shared_cluster.port) as proxy:
        url = postgres_url.replace(f":{shared_cluster.port}/", f":{proxy.port}/")
        options = "--db", url, "--robot-name", "r1", "--log-level", "error", "--speed", "0.01"
        server = await programs.start(TASK_SERVER, *options, ready="taskrpc-server ready")
        async with taskrpc.Node("user") as node:
            client = node.create_client(RobotTask, "/robot_task", timeout=60)
            acknowledged = set()

            async def submit(x):
                request = RobotTask.Request(task_type="move", target=f"{x},1.0", priority=5)
                try:
                    response = await client.call(request)
                except taskrpc.TaskRpcError:
                    counts["in doubt"] += 1
                    return
                acknowledged.update([request.target] if response.success else [])

            await submit(1.0)
            proxy.break_sessions()
            proxy.arm(CUT, away=True, what=b"INTO taskrpc_task")
            first = asyncio.gather(*(submit(1 + x / 10) for x in range(1, 7)))
            while proxy.is_armed:
                await asyncio.sleep(0.05)
            later = asyncio.gather(*(submit(2 + x / 10) for x in range(1, 7)))
            await asyncio.sleep(12)
            proxy.arm(SWALLOW)
            proxy.is_away = False
            await asyncio.gather(first, later)
            counts["cut before the COMMIT"] += not proxy.is_armed
        await kill(server)
    observer = PostgresStore(postgres_url, listen=False)
    stored = {each.target for each in (await observer.load()).tasks}
    await observer.close()
    counts["acknowledged"] += len(acknowledged)
    counts["acknowledged, not stored"] += len(acknowledged - stored)
    counts.check("acknowledged, not stored", happened=("cut before the COMMIT",))
    counts.require(acknowledged=7)
