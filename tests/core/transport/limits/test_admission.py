"""Connections of accounts when a server has as many as it can accept."""

import asyncio
import contextlib

import pytest

import taskrpc
from taskrpc import Accounts
from taskrpc.core.transport.limits import admission
from tests.core.security.test_accounts import ANA, OTTO
from tests.core.transport.helpers import Add, Gate, add, ask, outcome, until


def in_memory(name, account=None, **options):
    token = None if account is None else account.token
    return taskrpc.Node(name, transport="memory", token=token, **options)


class Crowd:
    """Programs of accounts, each with a connection of its own."""

    def __init__(self, server, stack):
        self.server = server
        self._stack = stack
        self._count = 0

    async def client(self, account):
        self._count += 1
        node = in_memory("program", account, listen=f"program {self._count}")
        node = await self._stack.enter_async_context(node)
        return node.create_client(Add, "/add", timeout=60)

    def principals(self):
        return sorted(each.principal for each in self.server._transport._served)


@pytest.fixture
async def crowd(monkeypatch):
    monkeypatch.setattr(admission, "MAX_CONNECTIONS", 4)
    async with (
        in_memory("server", accounts=Accounts([ANA, OTTO])) as server,
        contextlib.AsyncExitStack() as stack,
    ):
        yield Crowd(server, stack)


async def test_the_account_with_the_most_connections_loses_one_to_a_smaller_account(crowd, caplog):
    crowd.server.create_service(Add, "add", add)
    leaked = [await crowd.client(ANA) for _ in range(5)]
    answers = [await outcome(client.call(ask(2, 3))) for client in leaked]
    assert [getattr(each, "sum", 0) for each in answers] == [5, 5, 5, 5, 0]
    assert "the server has 4 connections, as many as it can" in str(answers[4])
    others = [await crowd.client(OTTO) for _ in range(3)]
    answers = [await outcome(client.call(ask(2, 3))) for client in others]
    assert [getattr(each, "sum", 0) for each in answers] == [5, 5, 0]
    await asyncio.sleep(1)
    assert crowd.principals() == ["ana", "ana", "otto", "otto"]
    assert "the account ana at this machine has 4 of them, and one is evicted" in caplog.text
    # The caller that lost a connection can call again once there is room.
    assert isinstance(await outcome(leaked[0].call(ask())), taskrpc.ServiceUnavailable)
    leaked[3]._channel._connection.close()
    await asyncio.sleep(1)
    assert (await leaked[0].call(ask(1, 1))).sum == 2


async def calling(crowd, account, number):
    client = await crowd.client(account)
    return asyncio.ensure_future(outcome(client.call(ask(number))))


async def test_an_idle_connection_gives_way_before_a_busy_one(crowd):
    crowd.server.create_service(Add, "add", gate := Gate(), concurrency=9)
    calls = [await calling(crowd, ANA, 0)]
    for _ in range(3):
        await (await crowd.client(ANA)).wait_for_service(5)
    calls += [await calling(crowd, OTTO, 1), await calling(crowd, OTTO, 2)]
    await until(lambda: sorted(gate.started) == [0, 1, 2])
    await asyncio.sleep(2 * admission.GRACE)
    gate.opened.set()
    assert [(await call).sum for call in calls] == [0, 1, 2]


async def test_endless_calls_do_not_prevent_an_eviction(crowd):
    crowd.server.create_service(Add, "add", gate := Gate(), concurrency=9)
    calls = [await calling(crowd, ANA, number) for number in range(4)]
    await until(lambda: len(gate.started) == 4)
    late = await calling(crowd, OTTO, 9)
    await until(lambda: 9 in gate.started)
    await asyncio.sleep(admission.GRACE / 2)
    assert not gate.cancelled
    await asyncio.sleep(admission.GRACE)
    assert gate.cancelled == [0]
    assert isinstance(await calls[0], taskrpc.OutcomeUnknown)
    gate.opened.set()
    assert [(await call).sum for call in (*calls[1:], late)] == [1, 2, 3, 9]
