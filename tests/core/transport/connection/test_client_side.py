"""When a deadline passes, the client asks the server whether the call had begun."""

import asyncio

import pytest

import taskrpc
from taskrpc.core.transport.connection.client_side import OpenCall
from taskrpc.core.transport.connection.deadline_timer import TICK
from taskrpc.core.wire.session import Session
from taskrpc.testing import FaultyNetwork
from tests.core.transport.helpers import Add, Gate, ask, outcome

SPAN = 0.1


class Lab:
    """A server that works on one call, and a client, on a network with a delay."""

    def __init__(self, network, server, user, gate):
        self.network, self.server, self.user, self.gate = network, server, user, gate
        self.client = user.create_client(Add, "add", timeout=None)

    async def expire(self, number=2):
        """Call under a deadline that passes; returns `not_executed`, and the delay in seconds."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        with pytest.raises(taskrpc.DeadlineExceeded) as caught:
            await self.client.call(ask(number), timeout=SPAN)
        return caught.value.not_executed, loop.time() - began - SPAN


@pytest.fixture
async def lab(request):
    delay = getattr(request, "param", 0.001)
    server = taskrpc.Node("server", transport="memory", listen="server")
    user = taskrpc.Node("user", transport="memory", listen="user")
    with FaultyNetwork(delay=(delay, delay)) as network:
        async with server, user:
            gate = Gate()
            server.create_service(Add, "add", gate)
            lab = Lab(network, server, user, gate)
            assert await lab.client.wait_for_service(60)
            running = lab.client.call_async(ask(1))
            await asyncio.sleep(1)
            yield lab
            gate.opened.set()
            await outcome(running)


async def test_expired_call_that_waited_behind_another_is_reported_as_not_executed(lab):
    not_executed, late = await lab.expire()
    assert not_executed is True
    assert late == pytest.approx(0.002)  # the way to the server and back
    lab.gate.opened.set()
    await asyncio.sleep(1)
    assert lab.gate.started == [1]


async def test_outcome_of_an_expired_call_that_had_begun_is_unknown(lab):
    lab.gate.opened.set()
    await asyncio.sleep(1)
    lab.gate.opened.clear()
    not_executed, late = await lab.expire()
    assert not_executed is None
    assert late == pytest.approx(0.002)
    assert lab.gate.cancelled == [2]
    lab.gate.opened.set()
    await lab.client.call(ask(3))


@pytest.mark.parametrize("lab", [0.01], indirect=True)
async def test_caller_waits_at_most_a_tick_for_the_answer_of_the_server(lab):
    not_executed, late = await lab.expire()
    assert not_executed is None
    assert 0 < late <= TICK
    lab.gate.opened.set()
    assert (await lab.client.call(ask(3))).sum == 3


async def test_caller_of_a_silent_server_waits_no_longer_than_a_tick(lab):
    lab.network.partition("server", "user")
    not_executed, late = await lab.expire()
    assert not_executed is None
    assert 0 < late <= TICK
    lab.network.heal()


async def test_connection_that_ends_within_that_tick_ends_the_call_at_once(lab):
    expiring = asyncio.ensure_future(lab.expire())
    await asyncio.sleep(SPAN + 0.0005)
    lab.network.cut("server", "user")
    not_executed, late = await expiring
    assert not_executed is None
    assert late < 0.002


async def test_response_within_that_tick_reaches_the_caller(lab):
    loop = asyncio.get_running_loop()
    loop.call_later(SPAN - 0.0005, lab.gate.opened.set)  # the answer takes 1 ms
    began = loop.time()
    assert (await lab.client.call(ask(2), timeout=SPAN)).sum == 2
    assert loop.time() - began == pytest.approx(SPAN + 0.0005)


async def test_error_of_a_callback_within_that_tick_reaches_the_caller(lab):
    async def refuse(request, response):
        await lab.gate(request, response)
        raise taskrpc.HandlerError(taskrpc.Code.NOT_FOUND, "no such shelf")

    lab.server.create_service(Add, "refuse", refuse)
    client = lab.user.create_client(Add, "refuse")
    assert await client.wait_for_service(60)
    asyncio.get_running_loop().call_later(SPAN - 0.0005, lab.gate.opened.set)
    with pytest.raises(taskrpc.HandlerFailed, match="no such shelf"):
        await client.call(ask(2), timeout=SPAN)


async def test_call_cancelled_within_that_tick_stays_cancelled(lab):
    call = asyncio.ensure_future(lab.client.call(ask(2), timeout=SPAN))
    await asyncio.sleep(SPAN + 0.0005)
    call.cancel()
    await asyncio.sleep(1)
    assert call.cancelled()
    lab.gate.opened.set()
    assert (await lab.client.call(ask(3))).sum == 3


async def test_many_calls_that_expire_behind_one_are_reported_as_not_executed(lab):
    calls = [lab.client.call(ask(n), timeout=SPAN + n / 10_000) for n in range(200)]
    errors = await asyncio.gather(*calls, return_exceptions=True)
    assert {type(error) for error in errors} == {taskrpc.DeadlineExceeded}
    assert {error.not_executed for error in errors} == {True}


async def test_late_call_that_its_server_refuses_is_not_sent_to_another():
    future = asyncio.get_running_loop().create_future()
    moved = []
    call = OpenCall(future, None, None, 0.0, 1, b"", moved.append, is_late=True)
    call.refused(taskrpc.ServiceUnavailable("withdrawn"))
    with pytest.raises(taskrpc.DeadlineExceeded) as caught:
        await future
    assert (caught.value.not_executed, moved) == (True, [])


async def test_late_call_is_cancelled_at_the_server_once(lab, monkeypatch):
    asked = []
    ask_to_stop = Session.ask_to_stop

    def counted(session, call_id):
        asked.append(call_id)
        ask_to_stop(session, call_id)

    monkeypatch.setattr(Session, "ask_to_stop", counted)
    lab.network.partition("server", "user")
    # Later deadlines in the same tick cause further checks of the calls that are late.
    calls = [lab.client.call(ask(n), timeout=SPAN + n / 1000) for n in range(5)]
    await asyncio.gather(*calls, return_exceptions=True)
    lab.network.heal()
    assert len(asked) == len(set(asked)) == 5
