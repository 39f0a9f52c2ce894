"""The program responds to calls of a deferred service later, in any order, from any thread."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc.testing import connected_nodes

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
Request, Response = AddTwoInts.Request, AddTwoInts.Response


@pytest.fixture
async def pair():
    async with connected_nodes("server", "client") as nodes:
        yield nodes


@pytest.fixture
async def taken(pair):
    server, _ = pair
    taken = []
    server.create_deferred_service(AddTwoInts, "add", taken.append)
    return taken


async def calls(pair, taken, *requests):
    """Futures of calls that have all been taken."""
    client = pair[1].create_client(AddTwoInts, "add")
    futures = [client.call_async(Request(a=a)) for a in requests]
    while len(taken) < len(requests):
        await asyncio.sleep(0.01)
    return futures


async def test_program_responds_in_any_order(pair, taken):
    futures = await calls(pair, taken, 1, 2, 3)
    done = []
    for future in futures:
        future.add_done_callback(lambda future: done.append(future.result().sum))
    for call in reversed(taken):
        call.reply(Response(sum=call.request.a * 10))
        await asyncio.sleep(0.1)
    assert done == [30, 20, 10]


async def test_an_error_ends_a_call_as_well(pair, taken):
    (future,) = await calls(pair, taken, 1)
    taken[0].fail(taskrpc.HandlerFailed(taskrpc.Code.NOT_FOUND, "no such sum"))
    with pytest.raises(taskrpc.HandlerFailed, match="no such sum"):
        await future


async def test_a_response_that_cannot_be_sent_leaves_the_call_open(pair, taken):
    (future,) = await calls(pair, taken, 1)
    with pytest.raises(taskrpc.InvalidRequest, match="sum: expected int64"):
        taken[0].reply(Response(sum="x"))
    taken[0].reply(Response(sum=4))
    assert (await future).sum == 4


async def test_only_the_first_answer_counts(pair, taken):
    (future,) = await calls(pair, taken, 1)
    taken[0].reply(Response(sum=4))
    taken[0].reply(Response(sum=5))
    taken[0].fail(taskrpc.ServerBusy("late"))
    assert (await future).sum == 4


async def test_call_whose_caller_gave_up_need_not_be_started(pair, taken):
    futures = await calls(pair, taken, 1, 2)
    futures[0].cancel()
    await asyncio.sleep(0.1)
    assert [call.started() for call in taken] == [False, True]
    assert taken[1].info.caller == "/client"


async def test_a_drain_waits_for_the_answers(pair, taken):
    (future,) = await calls(pair, taken, 1)
    drain = asyncio.ensure_future(pair[0].drain())
    await asyncio.sleep(1)
    assert not drain.done()
    taken[0].reply(Response(sum=4))
    await drain
    assert (await future).sum == 4


async def test_at_the_nodes_end_a_call_that_began_has_an_unknown_outcome(pair, taken):
    futures = await calls(pair, taken, 1, 2)
    taken[0].started()
    await pair[0].destroy()
    errors = await asyncio.gather(*futures, return_exceptions=True)
    assert [type(error) for error in errors] == [
        taskrpc.OutcomeUnknown,
        taskrpc.ServiceUnavailable,
    ]


async def test_status_counts_waiting_and_running_calls(pair, taken):
    await calls(pair, taken, 1, 2, 3)
    taken[0].started()
    (status,) = pair[0].status().services
    assert (status.name, status.running, status.waiting) == ("/add", 1, 2)
