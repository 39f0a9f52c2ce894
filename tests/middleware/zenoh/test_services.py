"""Native services: requests and responses as rmw_zenoh sends them, in both directions."""

from __future__ import annotations

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc.middleware.zenoh import attachment
from tests.core.transport.helpers import Add, add, ask, outcome, until
from tests.middleware.zenoh.helpers import GID

pytestmark = pytest.mark.real_time

REQUEST = bytes.fromhex("0001000002000000000000000300000000000000")
RESPONSE = bytes.fromhex("000100000500000000000000")


def answers(key, seen):
    def answer(query):
        with query:
            seen.append((query.payload.to_bytes(), query.attachment.to_bytes()))
            query.reply(key, RESPONSE, attachment=query.attachment)

    return answer


async def response_of(foreign, data, about=None):
    """What a foreign caller of /add gets, once the router knows the service."""
    while not (got := await asyncio.to_thread(foreign.ask, "/add", Add, data, about)):
        await asyncio.sleep(0.01)
    return got


async def ready(node, name="/add"):
    client = node.create_client(Add, name)
    assert await client.wait_for_service(10)
    return client


async def test_requests_are_those_of_rmw_zenoh(node, foreign):
    seen = []
    foreign.serve(
        "/add",
        Add,
        answers(f"0/add/{'example_interfaces::srv::dds_::AddTwoInts_'}/{Add._HASH}", seen),
    )
    client = await ready(node)
    assert (await client.call(ask(2, 3))).sum == 5
    await client.call(ask(2, 3))
    (first, about), (_, later) = seen
    assert first == REQUEST
    assert attachment.parse(about).sequence == 1
    assert attachment.parse(later).sequence == 2
    assert attachment.parse(about).gid == attachment.parse(later).gid


async def test_responses_repeat_the_sequence_and_the_gid_of_the_request(node, foreign):
    node.create_service(Add, "add", add)
    (sample,) = await response_of(foreign, REQUEST)
    assert sample.payload.to_bytes() == RESPONSE
    about = attachment.parse(sample.attachment.to_bytes())
    assert (about.sequence, about.gid) == (7, GID)
    assert about.stamp > 1_000_000_000


@pytest.mark.parametrize(
    ("data", "about", "error"),
    [
        (REQUEST, b"short", b"expected an attachment of 33 bytes"),
        (REQUEST[:-1], None, b"the request is not valid"),
        (b"", None, b"the request is not valid"),
    ],
)
async def test_invalid_requests_get_an_error_and_are_not_executed(
    node, foreign, data, about, error
):
    ran = []
    node.create_service(Add, "add", lambda *both: ran.append(both))
    (got,) = await response_of(foreign, data, about)
    assert got.startswith(error)
    assert not ran


async def test_a_foreign_caller_gets_the_error_of_a_callback_as_text(node, foreign):
    def refuse(request, response):
        raise taskrpc.HandlerError(taskrpc.Code.NOT_FOUND, "no such robot")

    node.create_service(Add, "add", refuse)
    (got,) = await response_of(foreign, REQUEST)
    assert got.startswith(b"HandlerFailed: ")
    assert b"no such robot" in got


async def test_an_error_of_a_foreign_server_is_the_handlers_failure(node, foreign):
    def refuse(query):
        with query:
            query.reply_err(b"out of paper")

    foreign.serve("/add", Add, refuse)
    client = await ready(node)
    with pytest.raises(taskrpc.HandlerFailed, match="/add failed: out of paper"):
        await client.call(ask())


async def test_a_foreign_server_that_drops_a_request_leaves_its_outcome_unknown(node, foreign):
    foreign.serve("/add", Add, lambda query: query.drop())
    client = await ready(node)
    with pytest.raises(taskrpc.OutcomeUnknown, match="/add ended the call without a response"):
        await client.call(ask())


async def test_an_invalid_response_is_the_handlers_failure(node, foreign):
    def garble(query):
        with query:
            query.reply(query.key_expr, b"garbage")

    foreign.serve("/add", Add, garble)
    client = await ready(node)
    with pytest.raises(taskrpc.HandlerFailed, match="the response of /add is not valid"):
        await client.call(ask())


async def test_a_call_ends_when_its_foreign_server_ends(node, foreign):
    held = []
    foreign.serve("/add", Add, held.append)
    client = await ready(node)
    call = client.call_async(ask(), timeout=None)
    await until(lambda: held)
    foreign.close()
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
    await until(lambda: not client.service_is_ready())
    with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /add"):
        await client.call(ask())


async def test_another_definition_is_refused_with_both_hashes(node, foreign):
    other = srvgen.define("example_interfaces/srv/AddTwoInts", "int32 a\nint32 b\n---\nint64 sum")
    foreign.serve("/add", other, lambda query: query.drop())
    network = node._transport.network
    await until(lambda: network.locate("/add"))
    with pytest.raises(taskrpc.TypeMismatch) as caught:
        await node.create_client(Add, "/add").call(ask())
    assert Add._HASH[:15] in str(caught.value)
    assert other._HASH[:15] in str(caught.value)


async def test_at_most_ten_calls_are_in_flight_to_one_foreign_server(node, foreign):
    held, seen = [], []
    foreign.serve("/add", Add, held.append)
    client = await ready(node)
    calls = [client.call_async(ask(n)) for n in range(25)]
    for expected in (10, 10, 5):
        await until(lambda expected=expected: len(held) == expected)
        await asyncio.sleep(0.02)
        assert len(held) == expected
        waiting, held[:] = list(held), []
        for query in waiting:
            answers(str(query.key_expr), seen)(query)
    assert [each.sum for each in await asyncio.gather(*calls)] == [5] * 25


async def test_a_server_without_a_type_hash_is_called_by_the_name_of_its_type(node, foreign):
    """As in ROS 2 Humble."""
    seen = []
    key = "0/add/example_interfaces::srv::dds_::AddTwoInts_/TypeHashNotSupported"
    foreign.serve("/add", Add, answers(key, seen), type_hash="TypeHashNotSupported")
    client = await ready(node)
    assert (await client.call(ask(2, 3))).sum == 5
