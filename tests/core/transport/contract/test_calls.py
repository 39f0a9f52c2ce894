"""Contract of every transport: responses, deadlines, cancelling, and all ways to await.

The contract suite (`test_*_contract*.py`) is one: all of it runs over memory and over TCP.
"""

import asyncio
import gc
import threading
import warnings

import pytest

import taskrpc
from taskrpc.core.wire.messages import DEFAULT_LIMITS
from tests.core.transport.helpers import (
    FAST,
    Add,
    Gate,
    Text,
    add,
    ask,
    outcome,
    served,
    until,
)

TICK = 0.005


# Calls


async def test_a_call_gets_its_response(net):
    _, client = await served(net)
    assert (await client.call(ask(2, 3))).sum == 5


async def test_nodes_that_share_an_endpoint_call_each_other(net):
    one, other = await net.node("one", shared=True), await net.node("other", shared=True)
    one.create_service(Add, "add", add)
    assert (await other.create_client(Add, "add").call(ask(1, 1))).sum == 2


async def test_a_thousand_calls_at_once_are_all_answered_each_with_its_own(net):
    _, client = await served(net)
    responses = await asyncio.gather(*[client.call_async(ask(n, 1)) for n in range(1000)])
    assert [each.sum for each in responses] == list(range(1, 1001))


@pytest.mark.parametrize("size", [1, 1000, 65_535, 65_536, 65_537, 1_000_000, 16 * 1024 * 1024])
async def test_bodies_of_any_size_arrive_whole_both_ways(net, size):
    def echo(request, response):
        response.message = request.task_type
        return response

    _, client = await served(net, echo, "echo", Text)
    text = ("x" * 1000 + "é")[: max(1, size % 1001)] * (size // 1001 + 1)
    assert (await client.call(Text.Request(task_type=text))).message == text


async def test_a_request_over_the_limit_is_refused_before_it_is_sent(net):
    _, client = await served(net, lambda request, response: response, "echo", Text)
    with pytest.raises(taskrpc.InvalidRequest, match=r"the server accepts 16842752") as caught:
        await client.call(Text.Request(task_type="x" * DEFAULT_LIMITS.body))
    assert caught.value.not_executed
    assert (await client.call(Text.Request(task_type="x"))).success is False


async def test_a_response_over_the_limit_is_the_handlers_failure(net, caplog):
    def too_much(request, response):
        response.message = "x" * DEFAULT_LIMITS.body
        return response

    _, client = await served(net, too_much, "big", Text)
    with pytest.raises(taskrpc.HandlerFailed, match="see the server's log"):
        await client.call(Text.Request())
    assert "the caller accepts 16842752" in caplog.text


async def test_small_calls_go_on_between_large_ones(net):
    def echo(request, response):
        response.message = request.task_type
        return response

    _, client = await served(net, echo, "echo", Text, concurrency=4)
    texts = ["x" * (3_000_000 if n % 5 == 0 else 10) + str(n) for n in range(30)]
    got = await asyncio.gather(*[client.call_async(Text.Request(task_type=t)) for t in texts])
    assert [each.message for each in got] == texts


# Deadlines


async def test_a_deadline_is_never_early_and_at_most_a_tick_late(net):
    _, client = await served(net, Gate(), concurrency=100)
    loop = asyncio.get_running_loop()
    late = []

    async def timed(timeout):
        began = loop.time()
        with pytest.raises(taskrpc.DeadlineExceeded) as caught:
            await client.call(ask(), timeout=timeout)
        assert isinstance(caught.value, TimeoutError)
        assert caught.value.not_executed is None
        late.append(loop.time() - began - timeout)

    await asyncio.gather(*[timed(0.05 + 0.0013 * n) for n in range(60)])
    assert min(late) >= -1e-6
    assert max(late) <= (TICK + 1e-6 if net.is_virtual else 0.5)


async def test_the_default_deadline_is_ten_seconds(net):
    left = []

    def look(request, response):
        left.append(taskrpc.current_call().time_left())
        return response

    _, client = await served(net, look)
    await client.call(ask())
    assert 9 < left[0] <= 10.001


@pytest.mark.parametrize("timeout", [0, -1])
async def test_a_deadline_that_has_passed_fails_without_sending(net, timeout):
    gate = Gate()
    _, client = await served(net, gate)
    with pytest.raises(taskrpc.DeadlineExceeded) as caught:
        await client.call(ask(), timeout=timeout)
    assert caught.value.not_executed
    assert await outcome(client.call(ask(), timeout=0.05))
    assert gate.started == [0]


async def test_a_call_without_a_deadline_waits_without_limit(net):
    gate = Gate()
    _, client = await served(net, gate)
    call = client.call_async(ask(7), timeout=None)
    await asyncio.sleep(3600 if net.is_virtual else 0.1)
    gate.opened.set()
    assert (await call).sum == 7


async def test_the_deadline_travels_with_the_call(net):
    left = []

    def look(request, response):
        left.append(taskrpc.current_call().time_left())
        return response

    _, client = await served(net, look)
    await client.call(ask(), timeout=4.0)
    await client.call(ask(), timeout=None)
    assert 3.5 < left[0] <= 4.001
    assert left[1] is None


async def test_a_call_that_expired_in_the_servers_queue_never_starts(net):
    gate = Gate()
    _, client = await served(net, gate)
    first = client.call_async(ask(1), timeout=None)
    queued = [client.call_async(ask(n), timeout=0.05) for n in range(2, 300)]
    errors = await asyncio.gather(*queued, return_exceptions=True)
    assert {type(error) for error in errors} == {taskrpc.DeadlineExceeded}
    known = {error.not_executed for error in errors}
    assert known == {True} if net.is_virtual else known <= {True, None}
    if not net.is_virtual:  # the server counts from the arrival of the calls
        await asyncio.sleep(0.3)
    gate.opened.set()
    await first
    assert (await client.call(ask(1000))).sum == 1000
    assert gate.started == [1, 1000]


async def test_expired_calls_make_room_in_the_servers_queue(net, monkeypatch):
    monkeypatch.setattr("taskrpc.service.QUEUE_LIMIT", 5)
    gate = Gate()
    _, client = await served(net, gate)
    first = client.call_async(ask(1), timeout=None)
    await asyncio.gather(
        *[client.call_async(ask(), timeout=0.05) for _ in range(5)], return_exceptions=True
    )
    second = client.call_async(ask(2), timeout=None)
    await asyncio.sleep(0.05)
    gate.opened.set()
    assert [(await first).sum, (await second).sum] == [1, 2]


# Cancelling


async def test_cancelling_the_future_cancels_the_async_callback(net):
    gate = Gate()
    _, client = await served(net, gate)
    future = client.call_async(ask(1))
    await until(lambda: gate.started)
    assert future.cancel()
    await until(lambda: gate.cancelled)
    gate.opened.set()
    assert (await client.call(ask(2))).sum == 2
    assert gate.answered == [2]


async def test_cancelling_the_awaiting_task_cancels_the_async_callback(net):
    gate = Gate()
    _, client = await served(net, gate)

    async def caller():
        await client.call(ask(1))

    task = asyncio.create_task(caller())
    await until(lambda: gate.started)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await until(lambda: gate.cancelled)


async def test_cancel_tells_a_threaded_callback(net):
    seen, release = threading.Event(), threading.Event()

    def patient(request, response):
        while not release.wait(0.001):
            if taskrpc.current_call().cancelled:
                seen.set()
                break
        return response

    _, client = await served(net, patient, threaded=True)
    future = client.call_async(ask(), timeout=None)
    loop = asyncio.get_running_loop()
    loop.call_later(0.02, future.cancel)
    if net.is_virtual:
        # The clock stands still while the thread runs: only bytes on their way can move.
        for _ in range(20):
            await asyncio.sleep(0)
        future.cancel()
    with pytest.raises(asyncio.CancelledError):
        await future
    await loop.run_in_executor(None, seen.wait, 5)
    release.set()
    assert seen.is_set()


async def test_a_cancelled_call_in_the_queue_never_starts(net):
    gate = Gate()
    _, client = await served(net, gate)
    first, second, third = (client.call_async(ask(n)) for n in (1, 2, 3))
    await until(lambda: gate.started)
    second.cancel()
    await asyncio.sleep(0.02)
    gate.opened.set()
    assert [(await first).sum, (await third).sum] == [1, 3]
    assert gate.started == [1, 3]


async def test_the_end_of_the_caller_cancels_its_calls(net):
    gate = Gate()
    server = await net.node()
    server.create_service(Add, "gate", gate)
    async with taskrpc.Node("brief", **net.options("brief")) as node:
        client = node.create_client(Add, "gate")
        await client.wait_for_service(60)
        call = client.call_async(ask(1))
        await until(lambda: gate.started)
    await until(lambda: gate.cancelled)
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)


# A call as an awaitable


async def test_a_call_never_awaited_is_reported(net):
    _, client = await served(net)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        client.call(ask())
        gc.collect()
    assert [str(each.message) for each in caught] == ["coroutine 'Client.call' was never awaited"]


async def test_a_call_stands_wherever_a_coroutine_can(net):
    _, client = await served(net)

    def call(n):
        return client.call(ask(n, n))

    assert (await asyncio.create_task(call(1))).sum == 2
    assert [each.sum for each in await asyncio.gather(call(1), call(2))] == [2, 4]
    async with asyncio.TaskGroup() as group:
        task = group.create_task(call(3))
    assert task.result().sum == 6
    assert (await asyncio.wait_for(call(4), 60)).sum == 8
    assert (await asyncio.shield(call(5))).sum == 10
    assert [(await each).sum for each in asyncio.as_completed([call(6)])] == [12]
    async with asyncio.timeout(60):
        assert (await call(7)).sum == 14


async def test_a_call_may_be_awaited_only_once(net):
    _, client = await served(net)
    call = client.call(ask(1, 1))
    await call
    with pytest.raises(RuntimeError, match="already awaited"):
        await call


async def test_a_task_of_a_call_cancelled_before_it_began_sends_nothing(net):
    gate = Gate()
    _, client = await served(net, gate)
    task = asyncio.create_task(client.call(ask(1)))
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await asyncio.sleep(0.01)
    assert not gate.started


async def test_wait_for_cancels_a_call_that_takes_too_long(net):
    gate = Gate()
    _, client = await served(net, gate)
    with pytest.raises(TimeoutError) as caught:
        await asyncio.wait_for(client.call(ask(1)), 0.05)
    assert not isinstance(caught.value, taskrpc.TaskRpcError)
    await until(lambda: gate.cancelled)


async def test_calls_without_a_reference_still_complete(net):
    done = []

    async def slow(request, response):
        await asyncio.sleep(0.01)
        done.append(request.a)
        return response

    server = await net.node()
    client = await net.client(Add, "slow", retry=FAST)
    for n in range(20):
        client.call_async(ask(n))
    await asyncio.sleep(0.02)
    gc.collect()
    server.create_service(Add, "slow", slow, concurrency=20)
    await asyncio.sleep(0.005)
    gc.collect()
    await until(lambda: len(done) == 20)
