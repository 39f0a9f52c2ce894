"""Observers of a server get one report of the end of each incoming call."""

import asyncio

import pytest

import taskrpc
import taskrpc.sync
from taskrpc import Code
from taskrpc.core.transport.connection.incoming_call import ObservedCall, RemoteCall
from tests.core.test_observer import Pair, Spans
from tests.core.transport.helpers import Add, Gate, Text, add, ask


@pytest.fixture
async def pair():
    async with Pair() as made:
        yield made


async def test_calls_of_a_lost_caller_are_reported_as_cancelled(pair):
    gate = Gate()
    client = pair.offer(gate)
    call = asyncio.ensure_future(client.call(ask()))
    await asyncio.sleep(1)
    await pair.client.destroy()
    await asyncio.wait([call])
    call.exception()
    await asyncio.sleep(1)
    assert pair.server_log.codes == [Code.CANCELLED]


async def test_invalid_request_is_reported_as_ended_but_not_as_begun(pair):
    client = pair.offer(lambda request, response: response, Text)
    await client.wait_for_service()
    client._channel._encode = lambda request: b"\xc1"
    with pytest.raises(taskrpc.InvalidRequest):
        await client.call(Text.Request())
    assert pair.server_log.began == []
    assert pair.server_log.codes == [Code.INVALID_ARGUMENT]


async def test_calls_without_an_observer_are_plain_calls(pair):
    client = pair.offer(add)
    await client.call(ask())

    def kinds(node):
        served = node._transport._served
        return {route.call for each in served for route in each.routes.values()}

    assert kinds(pair.server) == {ObservedCall}
    async with taskrpc.Node("unwatched", transport="memory", token="unwatched") as node:
        node.create_service(Add, "unwatched", add)
        await pair.client.create_client(Add, "unwatched").call(ask())
        assert kinds(node) == {RemoteCall}
        assert type(node.create_client(Add, "work")) is taskrpc.Client


@pytest.mark.parametrize("observer", [None, Spans()])
async def test_request_with_an_incomplete_span_is_refused(observer, pair):
    async with taskrpc.Node("traced", transport="memory", token="t", observer=observer) as server:
        server.create_service(Text, "traced", lambda request, response: response)
        client = pair.client.create_client(Text, "traced")
        await client.wait_for_service()
        client._channel.span_of = lambda: b"short"
        client._channel._encode = lambda request: b"\x91"
        with pytest.raises(taskrpc.ProtocolError, match="a traced request without its span"):
            await client.call(Text.Request())


async def test_server_without_an_observer_ignores_spans(pair):
    async with taskrpc.Node("plain", transport="memory", token="p") as server:
        server.create_service(Add, "plain", add)
        client = pair.client.create_client(Add, "plain")
        await client.wait_for_service()
        client._channel.span_of = lambda: bytes(25)
        assert (await client.call(ask(2, 3))).sum == 5
