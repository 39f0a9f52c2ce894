"""A service responds to each call exactly once, even if its callback fails or the service ends."""

import asyncio
import gc
import itertools
import random
import time
from functools import partial

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import taskrpc
from taskrpc.core.callinfo import Denied
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import IncomingCall
from taskrpc.service import QUEUE_LIMIT, SAMPLED, Service
from taskrpc.testing import VirtualTimeLoop
from tests.core.transport.helpers import Add, ask
from tests.properties import examples


class FakeTransport:
    def offer(self, offer):
        self.serve = offer.serve

    def withdraw(self, offer):
        pass


class Fake(IncomingCall, eq=False, kw_only=True):
    ends: list
    has_room: bool = True
    postponed: int = 0

    def must_wait(self):
        return not self.has_room

    def postpone(self):
        self.postponed += 1

    def reply(self, response):
        self.ends.append(response)

    def fail(self, error):
        # As on a connection: only the first terminal frame is sent.
        if not self.ends:
            self.ends.append(error)


def FakeCall(number, deadline=None):
    clock = asyncio.get_running_loop().time
    request = Add.Request(a=number)
    who = "/x", "/me", "", Role.ADMIN, number, deadline, clock
    return Fake(*who, request=request, arrived=clock(), ends=[])


def service(callback, **options):
    transport = FakeTransport()
    return transport, Service(transport, Add, "/x", "/server", callback, **options)


async def test_a_destroyed_service_finishes_when_its_last_call_is_answered():
    gate = asyncio.Event()

    async def wait(request, response):
        await gate.wait()
        return response

    transport, made = service(wait)
    calls = [FakeCall(n) for n in range(3)]
    for call in calls:
        transport.serve(call)
    made.destroy()
    await asyncio.sleep(1)
    assert not made.finished.done()
    gate.set()
    await made.finished
    assert all(len(call.ends) == 1 for call in calls)


async def test_idle_service_finishes_at_once():
    _, made = service(lambda request, response: response, threaded=True)
    made.destroy()
    made.destroy()
    assert made.finished.done()


async def test_call_after_the_end_of_a_service_is_sent_to_another_server():
    transport, made = service(lambda request, response: response)
    made.destroy()
    call = FakeCall(1)
    transport.serve(call)
    assert isinstance(call.ends[0], taskrpc.ServiceUnavailable)
    assert not call.started


async def test_call_whose_deadline_has_passed_is_not_executed():
    transport, _ = service(lambda request, response: response)
    call = FakeCall(1, deadline=asyncio.get_running_loop().time())
    transport.serve(call)
    assert isinstance(call.ends[0], taskrpc.DeadlineExceeded)
    assert call.ends[0].not_executed
    assert not call.started


async def test_queue_checks_deadlines_itself():
    """The timer may be a tick late; the callback must still not start."""
    loop = asyncio.get_running_loop()
    started = []

    async def note(request, response):
        started.append(request.a)
        await asyncio.sleep(0.010)
        return response

    transport, _ = service(note)
    calls = [FakeCall(0), FakeCall(1, deadline=loop.time() + 0.009), FakeCall(2)]
    for call in calls:
        transport.serve(call)
    await asyncio.sleep(1)
    assert started == [0, 2]
    assert isinstance(calls[1].ends[0], taskrpc.DeadlineExceeded)


async def test_call_with_too_little_time_left_is_refused_if_others_wait():
    loop = asyncio.get_running_loop()
    started = []

    async def work(request, response):
        started.append(request.a)
        await asyncio.sleep(1.0)
        return response

    transport, _ = service(work)
    calls = [FakeCall(n) for n in range(SAMPLED + 1)]
    for call in calls:
        transport.serve(call)
    await asyncio.sleep(SAMPLED - 0.5)
    late = FakeCall(100, deadline=loop.time() + 2.4)
    last = FakeCall(101, deadline=loop.time() + 9)
    for call in (late, last):
        call.caller = "/other"
        transport.serve(call)
    await asyncio.sleep(4)
    assert started == [*range(SAMPLED + 1), 101]
    assert isinstance(late.ends[0], taskrpc.ServerBusy)
    assert late.ends[0].not_executed
    assert "too little time was left" in str(late.ends[0])
    alone = FakeCall(102, deadline=loop.time() + 0.5)
    transport.serve(alone)
    await asyncio.sleep(2)
    assert started[-1] == 102, "no other call waits, so it starts"


async def test_abandoned_calls_have_an_unknown_outcome_only_if_they_began():
    async def forever(request, response):
        await asyncio.sleep(1e6)

    transport, made = service(forever, concurrency=2)
    calls = [FakeCall(n) for n in range(5)]
    for call in calls:
        transport.serve(call)
    made.abandon()
    kinds = [type(call.ends[0]) for call in calls]
    assert kinds == [taskrpc.OutcomeUnknown] * 2 + [taskrpc.ServiceUnavailable] * 3
    await made.finished


actions = st.lists(
    st.sampled_from(["call", "call", "call", "cancel", "wait", "destroy", "abandon"]), max_size=25
)


@settings(max_examples=examples(60))
@given(actions=actions, seed=st.integers(0, 1000), concurrency=st.integers(1, 3))
def test_every_call_ends_exactly_once_and_no_more_run_than_allowed(actions, seed, concurrency):
    chance = random.Random(seed)
    running, most = set(), [0]

    async def work(request, response):
        running.add(request.a)
        most.append(len(running))
        try:
            await asyncio.sleep(chance.choice([0, 0.1, 1]))
            if chance.random() < 0.2:
                raise ValueError("planned")
        finally:
            running.discard(request.a)
        return response

    async def play():
        transport, made = service(work, concurrency=concurrency)
        calls = []
        for action in actions:
            if action == "call":
                calls.append(FakeCall(len(calls)))
                transport.serve(calls[-1])
            elif action == "cancel" and calls:
                call = chance.choice(calls)
                if not call.ends:
                    call.cancel()
                    call.fail(taskrpc.TaskRpcError("cancelled"))
            elif action == "wait":
                await asyncio.sleep(chance.choice([0, 0.05, 2]))
            elif action == "destroy":
                made.destroy()
            elif action == "abandon":
                made.abandon()
        made.destroy()
        await made.finished
        await asyncio.sleep(0)
        assert [call.number for call in calls if not call.ends] == []
        assert max(most) <= concurrency
        assert not running
        assert not made._jobs

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(play())


async def test_one_call_runs_at_a_time_in_each_order_of_ends_cancels_and_arrivals():
    """The place of one running call is not given to two calls."""
    running, most = {}, []

    def work(request, response):
        future = asyncio.get_running_loop().create_future()
        running[request.a] = future, response
        most.append(len(running))
        return future

    def end(number):
        future, response = running.pop(number)
        future.set_result(response)

    async def rehearse(order, pauses):
        transport, made = service(work, concurrency=1)
        calls = [FakeCall(number) for number in range(4)]
        transport.serve(calls[0])
        transport.serve(calls[1])  # waits
        for step, turns in zip(order, pauses, strict=True):
            if step == "end 0":
                end(0)
            elif step != "leave 1":
                transport.serve(calls[int(step[-1])])
            elif not calls[1].ends and 1 not in running:
                calls[1].cancel()
                calls[1].fail(taskrpc.TaskRpcError("cancelled by the caller"))
            for _ in range(turns):
                await asyncio.sleep(0)
        for _ in range(20):
            await asyncio.sleep(0)
            for number in list(running):
                end(number)
        assert [len(call.ends) for call in calls] == [1] * 4, (order, pauses)
        assert max(most) == 1, (order, pauses)
        made.destroy()
        assert made.finished.done()

    for order in itertools.permutations(("end 0", "leave 1", "come 2", "come 3")):
        for pauses in itertools.product(range(3), repeat=4):
            await rehearse(order, pauses)


async def test_calls_that_arrive_while_one_ends_keep_their_order():
    order = []
    transport, _ = service(lambda request, response: order.append(request.a) or response)

    for n in range(5):
        transport.serve(FakeCall(n))
        if n % 2:
            await asyncio.sleep(0)
    await asyncio.sleep(1)
    assert order == sorted(order) == list(range(5))


@pytest.mark.parametrize("count", [1, 3])
async def test_an_async_callback_in_a_thread_runs_to_its_end(count):
    async def nested(request, response):
        await asyncio.sleep(0)
        response.sum = taskrpc.current_call().number
        return response

    transport, made = service(nested, threaded=True, concurrency=count)
    calls = [FakeCall(n) for n in range(4)]
    for call in calls:
        transport.serve(call)
    made.destroy()
    await made.finished
    assert [call.ends[0].sum for call in calls] == [0, 1, 2, 3]


async def test_callbacks_of_several_calls_may_return_the_same_future():
    """If a callback returns a future, its call ends with that future."""
    loop = asyncio.get_running_loop()
    shared = loop.create_future()
    transport, made = service(lambda request, response: shared, concurrency=3)
    calls = [FakeCall(n) for n in range(3)]
    for call in calls:
        loop.call_soon(transport.serve, call)
    await asyncio.sleep(1)
    assert [call.ends for call in calls] == [[], [], []]
    shared.set_result(answer := Add.Response(sum=7))
    await asyncio.sleep(1)
    calls.append(FakeCall(3))
    transport.serve(calls[-1])
    made.destroy()
    await made.finished
    assert [call.ends for call in calls] == [[answer]] * 4


@pytest.mark.parametrize("is_done", [False, True])
async def test_failed_future_of_a_callback_is_the_error_of_its_call(is_done):
    loop = asyncio.get_running_loop()
    failing = loop.create_future()
    fail = partial(failing.set_exception, taskrpc.HandlerError(taskrpc.Code.ABORTED, "too heavy"))
    transport, made = service(lambda request, response: failing)
    call = FakeCall(1)
    if is_done:
        fail()
    transport.serve(call)
    if not is_done:
        assert not call.ends
        fail()
    made.destroy()
    await made.finished
    [end] = call.ends
    assert (end.code, end.message) == (taskrpc.Code.ABORTED, "too heavy")


async def test_cancelled_call_cancels_its_future_and_frees_its_place():
    loop = asyncio.get_running_loop()
    futures = [loop.create_future() for _ in range(2)]
    transport, made = service(lambda request, response: futures[request.a])
    calls = [FakeCall(n) for n in range(2)]
    for call in calls:
        transport.serve(call)
    calls[0].cancel()
    await asyncio.sleep(1)
    assert futures[0].cancelled()
    futures[1].set_result(answer := Add.Response(sum=7))
    made.destroy()
    await made.finished
    assert [len(call.ends) for call in calls] == [1, 1]
    assert calls[1].ends == [answer]


@pytest.mark.parametrize("later", [False, True])
async def test_denial_by_a_callback_is_sent_but_a_denial_by_another_service_is_not(later):
    """The callback's own call was denied, not its caller's, and the callback may have acted."""
    errors = [Denied("not yours"), taskrpc.PermissionDenied("the lab's, to the callback")]

    async def callback(request, response):
        if later:
            await asyncio.sleep(1)
        raise errors.pop(0)

    transport, made = service(callback)
    calls = [FakeCall(n) for n in range(2)]
    for call in calls:
        asyncio.get_running_loop().call_soon(transport.serve, call)
    await asyncio.sleep(3)
    made.destroy()
    await made.finished
    (denied,), (failed,) = (call.ends for call in calls)
    assert (type(denied), str(denied)) == (taskrpc.PermissionDenied, "not yours")
    assert denied.not_executed
    assert failed.code is taskrpc.Code.INTERNAL
    assert "lab" not in failed.message


class Unfinished(taskrpc.HandlerError):
    def __init__(self, place):
        self.place = place


@pytest.mark.parametrize("later", [False, True])
async def test_handler_error_without_a_code_is_reported_and_frees_its_place(later, caplog):
    """The log names the attribute that is missing without HandlerError's `__init__`."""

    async def callback(request, response):
        if later:
            await asyncio.sleep(1)
        raise Unfinished("the gate")

    transport, made = service(callback)
    calls = [FakeCall(n) for n in range(2)]
    for call in calls:
        asyncio.get_running_loop().call_soon(transport.serve, call)
    await asyncio.sleep(3)
    made.destroy()
    await made.finished
    assert [call.ends[0].code for call in calls] == [taskrpc.Code.INTERNAL] * 2
    assert "Unfinished: the gate" in caplog.text
    assert "no attribute 'code'" in caplog.text


def end_plain(request, response):
    raise SystemExit(4)


async def end_at_once(request, response):
    raise SystemExit(4)


async def end_later(request, response):
    await asyncio.sleep(0.01)
    raise SystemExit(4)


@pytest.mark.parametrize("callback", [end_plain, end_at_once, end_later])
def test_call_gets_an_error_before_its_callback_ends_the_program(callback):
    """Otherwise the caller waits until its deadline for a program that has ended."""
    transport, calls = FakeTransport(), []

    async def serve():
        Service(transport, Add, "/x", "/server", callback)
        calls.append(FakeCall(1))
        transport.serve(calls[0])
        await asyncio.sleep(10)

    with pytest.raises(SystemExit), asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(serve())
    assert isinstance(calls[0].ends[0], taskrpc.HandlerFailed)


@pytest.mark.real_time
@pytest.mark.parametrize("callback", [end_plain, end_at_once, end_later])
def test_callback_can_end_a_spinning_program_without_a_wait(callback):
    """A call that raised is over: draining does not wait for it, whatever the event loop."""
    seconds = []

    async def spin():
        async with taskrpc.Node("server", token="s") as node:
            node.create_service(Add, "leave", callback)
            async with taskrpc.Node("caller", token="c") as caller:
                client = caller.create_client(Add, "leave")
                assert await client.wait_for_service(60)
                leaving = asyncio.ensure_future(client.call(ask()))
                began = time.monotonic()
                try:
                    await node.spin()
                finally:
                    seconds.append(time.monotonic() - began)
                    leaving.cancel()

    with pytest.raises(SystemExit):
        taskrpc.run(spin())
    assert seconds[0] < 10


@pytest.mark.parametrize("timeout", [float("nan"), float("inf"), "5"])
async def test_invalid_timeout_is_refused(timeout):
    async with taskrpc.Node("caller", transport="memory") as node:
        client = node.create_client(Add, "add")
        with pytest.raises(ValueError, match="timeout: expected seconds, or None"):
            await client.call(ask(), timeout=timeout)
        with pytest.raises(ValueError, match=r"wait_for_service: timeout: .*, got (nan|inf|'5')"):
            await client.wait_for_service(timeout)


@pytest.mark.parametrize("once", [False, True])
@pytest.mark.parametrize("kind", ["plain", "async", "threaded"])
async def test_calls_leave_no_reference_cycles(kind, once):
    """To collect reference cycles, a server would pause: longer if it has more objects."""

    def add(request, response):
        return response

    async def add_later(request, response):
        await asyncio.sleep(0)
        return response

    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        callback = add_later if kind == "async" else add
        store = taskrpc.MemoryCompletions() if once else None
        server.create_service(Add, "add", callback, threaded=kind == "threaded", exactly_once=store)
        client = node.create_client(Add, "add")
        assert await client.wait_for_service(timeout=60)

        async def garbage():
            """Objects that 100 calls leave for the collector."""
            gc.collect()
            for _ in range(100):
                await client.call(Add.Request())
            return gc.collect()

        await garbage()
        gc.disable()
        try:
            # The minimum of three: threads of earlier tests may leave garbage too.
            assert min([await garbage() for _ in range(3)]) < 100
        finally:
            gc.enable()


async def begun_and_waiting(count, **options):
    """A service whose one call runs until the gate opens, and calls that wait behind it."""
    gate = asyncio.Event()

    async def wait(request, response):
        await gate.wait()
        return response

    transport, made = service(wait, **options)
    calls = [FakeCall(n) for n in range(count + 1)]
    for call in calls:
        transport.serve(call)
    return transport, made, gate, calls


async def test_calls_without_room_for_their_responses_are_postponed_and_others_run():
    transport, _, gate, calls = await begun_and_waiting(0)
    mine, more, room = FakeCall(1), FakeCall(2), FakeCall(3)
    other = FakeCall(4)
    other.caller = "/other"
    for call in (mine, more, room, other):
        transport.serve(call)
    mine.has_room = more.has_room = False
    gate.set()
    await asyncio.sleep(1)
    assert [call.postponed for call in (mine, more, room, other)] == [1, 1, 0, 0]
    assert [len(call.ends) for call in (mine, more, room, other)] == [0, 0, 1, 1]
    assert len(calls[0].ends) == 1


async def test_runaway_caller_loses_its_newest_call_when_the_queue_is_full():
    transport, made, gate, calls = await begun_and_waiting(QUEUE_LIMIT)
    other = FakeCall(-1)
    other.caller = "/other"
    transport.serve(other)
    refused = calls[-1]
    (error,) = refused.ends
    assert isinstance(error, taskrpc.ServerBusy)
    assert str(error) == f"/x has {QUEUE_LIMIT} calls waiting"
    assert error.retry_after == 0.1
    assert made.status().waiting == QUEUE_LIMIT
    refused.cancel()  # it does not wait any more, so this has no effect
    assert made.status().waiting == QUEUE_LIMIT
    one_more = FakeCall(-2)
    transport.serve(one_more)
    assert isinstance(one_more.ends[0], taskrpc.ServerBusy), "its own caller has the most calls"
    gate.set()
    await asyncio.sleep(1)
    assert len(other.ends) == 1
    assert sum(bool(call.ends) for call in calls) == len(calls)


async def test_call_refused_for_too_little_time_gets_a_retry_after():
    """16 calls took a second each, so a call with less than 1.255 s left is not started."""
    loop = asyncio.get_running_loop()

    async def work(request, response):
        await asyncio.sleep(1.0)
        return response

    transport, _ = service(work)
    for number in range(SAMPLED + 1):
        transport.serve(FakeCall(number))
    await asyncio.sleep(SAMPLED - 0.5)
    turn = loop.time() + 1.5  # when the next caller's turn comes
    tight, last = FakeCall(100, deadline=turn + 1.252), FakeCall(101, deadline=turn + 9)
    for call in (tight, last):
        call.caller = "/other"
        transport.serve(call)
    await asyncio.sleep(4)
    assert isinstance(tight.ends[0], taskrpc.ServerBusy)
    assert tight.ends[0].retry_after == 0.1


async def test_log_shows_the_error_or_result_of_a_callback(caplog):
    def fail(request, response):
        raise ZeroDivisionError("one of the callback's own")

    def forget(request, response):
        pass

    for callback, expected in (
        (fail, "one of the callback's own"),
        (forget, "forget returned None; a service callback must `return response`"),
        (lambda request, response: 5, "the response cannot be sent: "),
        (
            lambda request, response: Add.Response(3),
            "takes its fields by name: write Add.",
        ),
    ):
        caplog.clear()
        transport, _ = service(callback)
        call = Refusing(**msgspec.structs.asdict(FakeCall(1)))
        transport.serve(call)
        (record,) = caplog.records
        assert expected in str(record.exc_info[1])
        assert "the handler failed; see the server's log" in str(call.ends[0])


class Refusing(Fake, eq=False):
    """A call that accepts only a response, like the call of a connection."""

    def reply(self, response):
        if not isinstance(response, Add.Response):
            raise taskrpc.InvalidRequest("", f"expected a response, got {response!r}")
        super().reply(response)


async def test_expired_call_gets_deadline_exceeded():
    transport, _ = service(lambda request, response: response)
    call = FakeCall(1, deadline=asyncio.get_running_loop().time())
    transport.serve(call)
    assert str(call.ends[0]) == "the deadline passed before the call began"


async def test_service_with_a_callback_of_other_parameters_is_not_offered():
    def greet(request):
        return request

    async with taskrpc.Node("server", transport="memory") as node:
        for threaded in (False, True):
            with pytest.raises(TypeError, match=r"takes a request, a response, got .*greet\(requ"):
                node.create_service(Add, "add", greet, threaded=threaded)
        with pytest.raises(TypeError, match="`take` of /add: expected a function that takes a ca"):
            node.create_deferred_service(Add, "add", lambda: None)
        assert node._services == {}
        node.create_service(Add, "add", lambda request, response: response)
