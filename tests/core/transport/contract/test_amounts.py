"""Many and large calls: order and bounded memory."""

from __future__ import annotations

import asyncio

import pytest

from tests.core.transport.helpers import Text, add, ask, served

BIG = 32 * 1024


async def test_sixty_four_calls_at_a_time_get_their_responses_in_order(net):
    started = []

    def note(request, response):
        started.append(request.a)
        return add(request, response)

    _, client = await served(net, note)
    for block in range(0, 640, 64):
        numbers = range(block, block + 64)
        done = []
        calls = [client.call_async(ask(number)) for number in numbers]
        for call in calls:
            call.add_done_callback(lambda it, done=done: done.append(it.result().sum))
        await asyncio.gather(*calls)
        assert done == list(numbers)
    assert started == list(range(640))


@pytest.mark.parametrize("total", [1000, pytest.param(10_000, marks=pytest.mark.faults)])
async def test_thousands_of_large_calls_to_a_slow_server_wait_in_the_client(net, total):
    """Only as many bytes are on their way as the server allows; the rest are the client's own."""
    if total > 1000 and not net.is_virtual:
        pytest.skip("takes long in real time")
    running, most = 0, 0

    async def slow(request, response):
        nonlocal running, most
        running += 1
        most = max(most, running)
        await asyncio.sleep(0.001)
        running -= 1
        return response

    server, client = await served(net, slow, "sink", Text, concurrency=8)
    request = Text.Request(task_type="x" * BIG)  # one object: this test does not measure its copies
    calls = [client.call_async(request, timeout=None) for _ in range(total)]
    (serving,) = server._transport._served
    connection = client._channel._connection
    limits, waiting = [], []
    while not all(call.done() for call in calls[-8:]):
        await asyncio.sleep(0.05)
        limits.append(serving.session.in_flight)
        waiting.append(connection.transport and connection.transport.get_write_buffer_size())
    assert len(await asyncio.gather(*calls)) == total
    assert most == 8
    assert max(limits) <= 256
    assert max(waiting) <= 64 * 1024 * 1024
