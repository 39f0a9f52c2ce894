"""A client waits as its retry policy says, and never longer than its deadline."""

import asyncio
import inspect
import itertools

import pytest

import taskrpc
from taskrpc.retry import RetryPolicy
from tests.core.transport.helpers import Add, Gate, add, ask, outcome


@pytest.fixture
async def node():
    async with taskrpc.Node("node", transport="memory") as node:
        yield node


def failing(times, error):
    """A callback that raises `error` so many times, and the instants at which it was called."""
    instants = []

    def callback(request, response):
        instants.append(asyncio.get_running_loop().time())
        if len(instants) <= times:
            raise error
        return response

    return instants, callback


def gaps(instants):
    return [round(b - a, 6) for a, b in itertools.pairwise(instants)]


async def test_policy_of_the_lecture_waits_one_two_and_four_seconds(node):
    unavailable = taskrpc.HandlerError("UNAVAILABLE", "not yet")
    instants, callback = failing(9, unavailable)
    node.create_service(Add, "flaky", callback)
    policy = RetryPolicy(attempts=4, wait_initial=1, wait_max=8, wait_jitter=0)
    client = node.create_client(Add, "flaky", retry=policy, timeout=60)
    with pytest.raises(taskrpc.HandlerFailed, match="not yet"):
        await client.call(ask())
    assert gaps(instants) == [1, 2, 4]


async def test_retry_after_the_deadline_is_not_awaited(node):
    unavailable = taskrpc.HandlerError("UNAVAILABLE", "not yet")
    instants, callback = failing(9, unavailable)
    node.create_service(Add, "flaky", callback)
    policy = RetryPolicy(wait_initial=4, wait_jitter=0, wait_max=4)
    client = node.create_client(Add, "flaky", retry=policy, timeout=10)
    with pytest.raises(taskrpc.HandlerFailed, match="not yet"):
        await client.call(ask())
    assert gaps(instants) == [4, 4]


async def test_retry_waits_as_long_as_a_busy_server_asks(node, monkeypatch):
    monkeypatch.setattr("taskrpc.service.QUEUE_LIMIT", 0)
    gate = Gate()
    node.create_service(Add, "gate", gate)
    client = node.create_client(Add, "gate", retry=RetryPolicy(wait_initial=0, wait_jitter=0))
    first = client.call_async(ask(1))
    await asyncio.sleep(0.01)
    second = client.call_async(ask(2))
    await asyncio.sleep(0.05)
    gate.opened.set()
    assert (await first).sum == 1
    began = asyncio.get_running_loop().time()
    assert (await second).sum == 2
    assert asyncio.get_running_loop().time() - began >= 0.04  # of the 0.1 s in the server's error


async def test_empty_budget_limits_retries_to_three_a_second(node):
    instants, callback = failing(10**6, taskrpc.HandlerError("UNAVAILABLE", "no"))
    node.create_service(Add, "down", callback)
    policy = RetryPolicy(wait_initial=0, wait_jitter=0)
    client = node.create_client(Add, "down", retry=policy, timeout=19.9)
    assert isinstance(await outcome(client.call(ask())), taskrpc.HandlerFailed)
    assert 11 + 3 * 18 <= len(instants) <= 11 + 3 * 20
    assert gaps(instants)[-1] == pytest.approx(1 / 3)


async def test_arguments_of_a_call_override_the_defaults_of_its_client(node):
    instants, callback = failing(1, taskrpc.HandlerError("UNAVAILABLE", "no"))
    node.create_service(Add, "flaky", callback)
    client = node.create_client(Add, "flaky", retry=RetryPolicy(), timeout=5)
    with pytest.raises(taskrpc.HandlerFailed):
        await client.call(ask(), retry=None)
    assert len(instants) == 1
    with pytest.raises(taskrpc.DeadlineExceeded):
        await client.call(ask(), timeout=0)


async def test_the_deadline_covers_waiting_and_retries_together(node):
    client = node.create_client(Add, "absent", retry=RetryPolicy(), timeout=3)
    began = asyncio.get_running_loop().time()
    with pytest.raises(taskrpc.ServiceUnavailable):
        await client.call(ask())
    assert asyncio.get_running_loop().time() - began == pytest.approx(3, abs=0.01)


async def test_call_that_waits_for_a_server_can_be_cancelled(node):
    client = node.create_client(Add, "absent", retry=RetryPolicy())
    call = client.call_async(ask())
    await asyncio.sleep(1)
    call.cancel()
    with pytest.raises(asyncio.CancelledError):
        await call
    node.create_service(Add, "absent", add)
    assert (await client.call(ask(1))).sum == 1


async def test_waiting_client_ignores_other_services(node):
    client = node.create_client(Add, "absent")
    waiting = asyncio.create_task(client.wait_for_service(3))
    for n in range(20):
        node.create_service(Add, f"other{n}", add)
        await asyncio.sleep(0.1)
    assert await waiting is False


async def test_call_is_a_coroutine(node):
    node.create_service(Add, "add", add)
    call = node.create_client(Add, "add").call(ask(1, 2))
    assert inspect.isawaitable(call)
    assert asyncio.iscoroutine(call)
    assert (await call).sum == 3


async def test_no_call_overtakes_those_that_wait_for_the_connection(node):
    """The connection may be ready in any iteration of the loop between two calls."""
    arrived = []

    def note(request, response):
        arrived.append(request.a)
        return response

    node.create_service(Add, "note", note)
    for turns in range(20):
        client = node.create_client(Add, "note")
        calls = [client.call_async(ask(number)) for number in range(2)]
        for _ in range(turns):
            await asyncio.sleep(0)
        calls.append(client.call_async(ask(2)))
        await asyncio.gather(*calls)
        assert arrived == [0, 1, 2], f"{turns} turns after the first calls"
        arrived.clear()
        client.destroy()


async def test_a_call_cancelled_as_soon_as_the_connection_sent_it_is_cancelled_at_the_server(node):
    gate = Gate()
    node.create_service(Add, "gate", gate)
    client = node.create_client(Add, "gate")
    call = client.call_async(ask(1))
    while not client._channel.ready:
        await asyncio.sleep(0)
    assert gate.started == []
    call.cancel()
    with pytest.raises(asyncio.CancelledError):
        await call
    await asyncio.sleep(0.1)
    assert gate.started == gate.cancelled
    assert node.status().services[0].running == 0


async def test_a_call_sent_over_a_connection_that_is_lost_at_once_has_an_unknown_outcome(node):
    """The connection is lost before the call's own task has run."""
    gate = Gate()
    node.create_service(Add, "gate", gate)
    client = node.create_client(Add, "gate", timeout=2)
    call = client.call_async(ask(1))
    while not client._channel.ready:
        await asyncio.sleep(0)
    client._channel._connection.transport.abort()
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
