"""Contract of every transport: an attempt that times out is repeated, if that is safe."""

from __future__ import annotations

import pytest

import taskrpc
from taskrpc.testing import CallFaults
from tests.core.transport.helpers import Add, Gate, add, ask, until

POLICY = taskrpc.RetryPolicy(attempt_timeout=0.2, wait_initial=0.01, wait_jitter=0)


def modes():
    return {"idempotent": True}, {"exactly_once": taskrpc.MemoryCompletions()}


async def losing(net, callback, **mode):
    """A client of a service that loses its first response."""
    server = await net.node("server", faults=CallFaults("lose-response:first=1"))
    server.create_service(Add, "add", callback, **mode)
    client = await net.client(Add, "add")
    assert await client.wait_for_service(60)
    return client


@pytest.mark.parametrize("mode", [0, 1], ids=["idempotent", "exactly once"])
async def test_lost_response_is_repeated_after_the_timeout_of_the_attempt(net, mode):
    ran = []

    def callback(request, response):
        ran.append(request.a)
        return add(request, response)

    client = await losing(net, callback, **modes()[mode])
    assert (await client.call(ask(2, 3), timeout=30, retry=POLICY)).sum == 5
    assert client.retries == 1
    assert ran == [2] * (2 - mode)


async def test_attempt_without_a_response_is_cancelled_at_an_idempotent_server(net):
    gate, server = Gate(), await net.node("server")
    server.create_service(Add, "gate", gate, idempotent=True, concurrency=5)
    client = await net.client(Add, "gate")
    assert await client.wait_for_service(60)
    call = client.call_async(ask(1, 2), timeout=30, retry=POLICY)
    await until(lambda: gate.cancelled)
    await until(lambda: len(gate.started) > 1)
    gate.opened.set()
    assert (await call).sum == 1
    assert gate.started[:2] == [1, 1]


async def test_slow_exactly_once_handler_goes_on_while_its_request_is_repeated(net):
    gate, server = Gate(), await net.node("server")
    server.create_service(Add, "gate", gate, exactly_once=taskrpc.MemoryCompletions())
    client = await net.client(Add, "gate")
    assert await client.wait_for_service(60)
    call = client.call_async(ask(1), timeout=30, retry=POLICY)
    await until(lambda: client.retries == 2)
    gate.opened.set()
    assert (await call).sum == 1
    assert (gate.started, gate.cancelled) == ([1], [])


async def test_attempt_timeout_is_refused_for_a_service_that_may_not_run_twice(net):
    ran, server = [], await net.node("server")
    server.create_service(Add, "add", lambda request, _: ran.append(request))
    client = await net.client(Add, "add")
    refusal = r"attempt_timeout: expected an idempotent or exactly-once service, but /add is"
    for call in (client.call, client.call_async):
        with pytest.raises(taskrpc.InvalidRequest, match=refusal) as caught:
            await call(ask(1), retry=POLICY)
        assert caught.value.not_executed is True
    assert ran == []


async def test_call_whose_attempts_are_used_up_says_how_many_there_were(net):
    server = await net.node("server", faults=CallFaults("lose-response"))
    server.create_service(Add, "add", add, idempotent=True)
    client = await net.client(Add, "add")
    assert await client.wait_for_service(60)
    policy = taskrpc.RetryPolicy(attempts=3, attempt_timeout=0.05, wait_initial=0.01)
    with pytest.raises(taskrpc.DeadlineExceeded, match=r"^3 attempts of at most 0\.05 s") as caught:
        await client.call(ask(1), timeout=60, retry=policy)
    assert caught.value.not_executed is None
    assert client.retries == 2
