"""One call over a channel with planned failures: which requests are repeated, and at what cost."""

import asyncio
import copy
import math
from functools import partial

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from taskrpc.client import Client
from taskrpc.core.attempts import FREE_RETRIES, Attempts
from taskrpc.core.request_ids.ids import RequestCounter, named_request_id
from taskrpc.core.transport.base import Mode
from taskrpc.errors import (
    Code,
    ConnectionLost,
    DeadlineExceeded,
    HandlerFailed,
    OutcomeUnknown,
    ServerBusy,
    ServiceUnavailable,
    SessionExpired,
    TaskRpcError,
)
from taskrpc.retry import RetryBudget, RetryPolicy
from taskrpc.testing import VirtualTimeLoop
from tests.core.transport.helpers import Add
from tests.properties import examples

AT_ONCE = RetryPolicy(wait_initial=0.01, wait_max=0.01, wait_jitter=0)


class Sent:
    """A call that was sent and already has its outcome."""

    counter, sequence = None, 0

    def __init__(self, outcome):
        self.future = asyncio.get_running_loop().create_future()
        self.cancelled = False
        if isinstance(outcome, BaseException):
            self.future.set_exception(outcome)
        elif outcome is not NEVER:
            self.future.set_result(outcome)

    def cancel(self, future=None):
        self.cancelled = True


NEVER = object()
"""The outcome of a call without a response."""


class FakeChannel:
    """Gives each attempt the next of these outcomes; a function may change the server then."""

    service_name = "/add"

    def __init__(self, *outcomes, mode=Mode.EXACTLY_ONCE, store_id=b"S" * 16, ready=True):
        self.outcomes = list(outcomes)
        self.mode, self.store_id, self.ready = mode, store_id, ready
        self.sent, self.calls, self.deadlines = [], [], []
        self.counters = {}
        self.line = []

    def counter(self):
        counter = self.counters.get(self.store_id)
        if counter is None or counter.is_retired:
            client = bytes([len(self.counters) + 1]) * 16
            counter = self.counters[self.store_id] = RequestCounter(client, self.store_id)
        return counter

    async def connect(self, deadline):
        self.deadlines.append(deadline)
        self.ready = True

    def begin_when_connected(self, call):
        self.line.append(call)

    def forget_waiting(self, call):
        self.line.remove(call)

    def send(self, request, deadline, number=None, left=0):
        self.sent.append(number)
        outcome = self.outcomes.pop(0)
        if isinstance(outcome, tuple):
            outcome, change = outcome
            change(self)
        self.calls.append(Sent(outcome))
        return self.calls[-1]


def attempts(channel, policy=AT_ONCE, budget=None, timeout=600.0, request_id=""):
    loop = asyncio.get_running_loop()
    deadline = None if timeout is None else loop.time() + timeout
    budget = budget or RetryBudget()
    return Attempts(channel, "request", deadline, policy, budget, loop.time, request_id)


def lost(not_executed=False):
    return ConnectionLost("lost", not_executed=not_executed)


def another_store(channel):
    channel.store_id = b"T" * 16


def no_longer_exactly_once(channel):
    channel.mode, channel.store_id = Mode.IDEMPOTENT, b""


@pytest.mark.parametrize("losses", [1, FREE_RETRIES, FREE_RETRIES + 1, FREE_RETRIES + 3])
async def test_exactly_once_call_survives_eight_lost_connections_without_the_budget(losses):
    assert FREE_RETRIES == 8
    channel, budget = FakeChannel(*[lost() for _ in range(losses)], "response"), RetryBudget()
    assert await attempts(channel, budget=budget).result() == "response"
    assert [number.sequence for number in channel.sent] == [1] * (losses + 1)
    assert budget.booked == max(0, losses - 8)


async def test_idempotent_call_takes_every_retry_from_the_budget():
    channel = FakeChannel(lost(), lost(), "response", mode=Mode.IDEMPOTENT, store_id=b"")
    budget = RetryBudget()
    assert await attempts(channel, budget=budget).result() == "response"
    assert budget.booked == 2


async def test_success_earns_a_tenth_of_a_retry():
    budget = RetryBudget()
    channel = FakeChannel(lost(), "response", mode=Mode.IDEMPOTENT, store_id=b"")
    await attempts(channel, budget=budget).result()
    assert budget.spent == pytest.approx(0.9)


async def test_call_whose_deadline_has_passed_is_not_sent():
    channel = FakeChannel(ready=False)
    with pytest.raises(DeadlineExceeded, match="had passed before the call began") as caught:
        await attempts(channel, timeout=0.0).result()
    assert caught.value.not_executed is True
    assert (channel.sent, channel.deadlines) == ([], [])


@pytest.mark.parametrize("timeout", [None, 5.0])
async def test_service_is_searched_for_until_the_deadline(timeout):
    channel = FakeChannel("response", ready=False)
    assert await attempts(channel, timeout=timeout).result() == "response"
    now = asyncio.get_running_loop().time()
    assert channel.deadlines == [None if timeout is None else now + timeout]


async def test_call_without_a_deadline_is_repeated_too():
    channel = FakeChannel(lost(), "response")
    assert await attempts(channel, timeout=None).result() == "response"


@pytest.mark.parametrize(("timeout", "sendings"), [(0.009, 1), (0.01, 1), (0.011, 2)])
async def test_retry_that_would_come_after_the_deadline_is_not_awaited(timeout, sendings):
    channel, loop = FakeChannel(lost(), "response"), asyncio.get_running_loop()
    began = loop.time()
    call = attempts(channel, timeout=timeout)
    if sendings == 1:
        with pytest.raises(ConnectionLost):
            await call.result()
        assert loop.time() == began
    else:
        assert await call.result() == "response"
    assert len(channel.sent) == sendings


async def test_cancelled_call_is_cancelled_at_the_server():
    channel = FakeChannel(NEVER)
    call = asyncio.ensure_future(attempts(channel).result())
    await asyncio.sleep(1)
    assert not channel.calls[0].cancelled
    call.cancel()
    with pytest.raises(asyncio.CancelledError):
        await call
    assert channel.calls[0].cancelled


# Request ids


async def test_request_id_belongs_to_its_service():
    channel = FakeChannel("response")
    await attempts(channel, request_id="order 1").result()
    assert channel.sent == [named_request_id("/add", "order 1")]


@pytest.mark.parametrize("change", [another_store, no_longer_exactly_once])
async def test_request_that_may_have_run_is_not_sent_to_another_store(change):
    channel, loop = FakeChannel((lost(), change)), asyncio.get_running_loop()
    began = loop.time()
    with pytest.raises(OutcomeUnknown, match="an earlier attempt of the call may have run"):
        await attempts(channel).result()
    assert len(channel.sent) == 1
    assert loop.time() - began < 1, "the call must not wait"


async def test_request_that_did_not_run_gets_a_new_number_for_the_next_store():
    channel = FakeChannel((lost(not_executed=True), another_store), "response")
    assert await attempts(channel).result() == "response"
    assert [number.client[0] for number in channel.sent] == [1, 2]
    for counter in channel.counters.values():
        assert counter.request_id(2).first_incomplete == 2, "the number is still in use"


async def test_request_that_did_not_run_may_be_sent_without_a_number():
    unsent = ServiceUnavailable("gone", not_executed=True)
    channel = FakeChannel((unsent, no_longer_exactly_once), "response")
    assert await attempts(channel).result() == "response"
    assert [number is None for number in channel.sent] == [False, True]


async def test_forgotten_client_is_replaced_at_once_but_only_once():
    channel, loop = (
        FakeChannel(SessionExpired("a"), SessionExpired("b")),
        asyncio.get_running_loop(),
    )
    began = loop.time()
    with pytest.raises((OutcomeUnknown, SessionExpired), match="b"):
        await attempts(channel).result()
    assert [number.client[0] for number in channel.sent] == [1, 2]
    assert loop.time() == began


async def test_forgotten_request_id_is_not_sent_again():
    channel = FakeChannel(SessionExpired("forgotten"))
    with pytest.raises((OutcomeUnknown, SessionExpired)):
        await attempts(channel, request_id="order 1").result()
    assert len(channel.sent) == 1


class Transport:
    """Gives a client this channel."""

    def __init__(self, channel):
        self._channel = channel

    def channel(self, name, srv_type, node, *, otherwise):
        return self._channel


class CountingChannel(FakeChannel):
    """A fake channel that also takes sequence numbers itself, as `RemoteChannel` does."""

    def send(self, request, deadline, number=None, left=0):
        if number is not None or not self.store_id:
            return super().send(request, deadline, number)
        counter = self.counter()
        sequence = counter.take()
        call = super().send(request, deadline, counter.request_id(sequence))
        call.counter, call.sequence = counter, sequence
        return call


def fresh(outcome):
    """The same outcome again: a raised error must not be shared between two runs."""
    return copy.copy(outcome)


def result_of(outcomes, mode, run):
    """The effects of one call: its response or error, the ids sent, the settled numbers."""

    async def main():
        store_id = b"S" * 16 if mode is Mode.EXACTLY_ONCE else b""
        channel = CountingChannel(*map(fresh, outcomes), mode=mode, store_id=store_id)
        client = Client(Transport(channel), Add, "/add", "/me", timeout=60.0)
        try:
            result = await run(client, channel)
        except TaskRpcError as error:
            result = type(error), str(error), error.not_executed
        settled = [each.request_id(9).first_incomplete for each in channel.counters.values()]
        return result, channel.sent, settled, client.retries

    with asyncio.Runner(loop_factory=partial(VirtualTimeLoop, 1)) as runner:
        return runner.run(main())


FAILURES = (
    ConnectionLost("lost"),
    ConnectionLost("lost", not_executed=True),
    ServiceUnavailable("gone"),
    ServerBusy("busy", retry_after=0.5),
    HandlerFailed(Code.INTERNAL, "bad"),
    DeadlineExceeded("no response by the deadline"),
    OutcomeUnknown("unknown"),
)


@settings(max_examples=examples(60), deadline=None)
@given(
    mode=st.sampled_from([Mode.AT_MOST_ONCE, Mode.IDEMPOTENT, Mode.EXACTLY_ONCE]),
    failures=st.lists(st.sampled_from(FAILURES), max_size=4),
)
def test_fast_path_of_a_client_behaves_as_attempts_do(mode, failures):
    outcomes = [*failures, "response"]

    async def fast(client, channel):
        return await client.call("request")

    async def slow(client, channel):
        loop = asyncio.get_running_loop()
        deadline = loop.time() + 60.0
        budget = client._budget
        return await Attempts(channel, "request", deadline, None, budget, loop.time).result()

    assert result_of(outcomes, mode, fast) == result_of(outcomes, mode, slow)


# The timeout of an attempt

DELAYS = st.none() | st.integers(1, 12)
"""Seconds until the response of an attempt, None for never. Odd halves avoid ties with timers."""


class TimedChannel(FakeChannel):
    """Each attempt gets its response after a delay, or fails at its deadline; as a server does."""

    def send(self, request, deadline, number=None, left=0):
        loop, delay = asyncio.get_running_loop(), self.outcomes[0]
        self.outcomes[0] = NEVER
        call = super().send(request, deadline, number)
        call.began, call.deadline = loop.time(), deadline
        end = math.inf if deadline is None else deadline

        def respond(outcome):
            if call.future.done():
                return
            if isinstance(outcome, Exception):
                call.future.set_exception(outcome)
            else:
                call.future.set_result(outcome)

        if delay is not None and loop.time() + delay + 0.5 < end:
            loop.call_later(delay + 0.5, respond, "response")
        elif deadline is not None:
            loop.call_at(end, respond, DeadlineExceeded("no response by the deadline"))
        return call


def predicted(delays, attempt_timeout, wait, timeout, limit):
    """How a call with these attempts must end: the result, its time, and when attempts began."""
    now, began = 0.0, []
    for delay in delays:
        began.append(now)
        end = min(now + attempt_timeout, timeout)
        if delay is not None and now + delay + 0.5 < end:
            return "response", now + delay + 0.5, began
        now = end
        if len(began) == limit or now + wait >= timeout:
            return "late", now, began
        now += wait
    raise AssertionError("a call with limited attempts ends")


def timed_call(wrong, mode, delays, attempt_timeout, wait, timeout, limit):
    """How a call with these attempts ends, in virtual time."""

    async def main():
        loop = asyncio.get_running_loop()
        store_id = b"S" * 16 if mode is Mode.EXACTLY_ONCE else b""
        channel = TimedChannel(*delays, mode=mode, store_id=store_id)
        policy_class = wrong if issubclass(wrong, RetryPolicy) else RetryPolicy
        attempts_class = wrong if issubclass(wrong, Attempts) else Attempts
        policy = policy_class(
            attempts=limit,
            attempt_timeout=attempt_timeout,
            wait_initial=wait,
            wait_max=wait,
            wait_jitter=0,
        )
        budget, request = RetryBudget(), "request"
        call = attempts_class(channel, request, timeout, policy, budget, loop.time)
        try:
            outcome = await call.result()
        except DeadlineExceeded as error:
            outcome, text = "late", str(error)
        else:
            text = ""
        if outcome == "late" and len(channel.calls) > 1:
            assert text.startswith(f"{len(channel.calls)} attempts of at most")
        assert loop.time() <= timeout
        assert all(each.future.done() for each in channel.calls), "an attempt was left open"
        assert budget.booked == len(channel.calls) - 1
        if mode is Mode.EXACTLY_ONCE:
            assert {each.sequence for each in channel.sent} == {1}
            assert {each.deadline for each in channel.calls} == {timeout}
        return outcome, loop.time(), [each.began for each in channel.calls]

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main())


timed_calls = {
    "mode": st.sampled_from([Mode.IDEMPOTENT, Mode.EXACTLY_ONCE]),
    "delays": st.lists(DELAYS, min_size=5, max_size=5),
    "attempt_timeout": st.integers(1, 6),
    "wait": st.integers(0, 4),
    "timeout": st.integers(1, 40),
    "limit": st.integers(1, 5),
}


@settings(max_examples=examples(200), deadline=None)
@given(**timed_calls)
def test_each_attempt_ends_at_its_timeout_and_the_call_at_its_deadline(mode, delays, **times):
    assert timed_call(Attempts, mode, delays, **times) == predicted(delays, **times)


class NeverTimesOut(RetryPolicy):
    def attempt_ends(self, now, deadline):
        return deadline


class IgnoresDeadline(RetryPolicy):
    def attempt_ends(self, now, deadline):
        return now + self.attempt_timeout


class KeepsLateAttempts(Attempts):
    def _forget_late(self):
        self._late = None


class CancelsBeforeItRepeats(Attempts):
    """Ends an exactly-once request at the server with its first attempt."""

    def _send(self):
        end = self.policy.attempt_ends(self.now(), self.deadline)
        return self.channel.send(self.request, end, self._request_id())


@pytest.mark.parametrize(
    "wrong", [NeverTimesOut, IgnoresDeadline, KeepsLateAttempts, CancelsBeforeItRepeats]
)
def test_wrong_timeouts_of_attempts_are_found(wrong):
    # Any example will do: to make it smaller would take most of the time.
    phases = [Phase.generate]

    @settings(max_examples=200, deadline=None, database=None, derandomize=True, phases=phases)
    @given(**timed_calls)
    def check(mode, delays, **times):
        assert timed_call(wrong, mode, delays, **times) == predicted(delays, **times)

    with pytest.raises(AssertionError):
        check()


async def test_late_attempt_is_cancelled_only_after_the_next_one_was_sent():
    channel = FakeChannel(NEVER, NEVER, "response")
    policy = RetryPolicy(attempt_timeout=5, wait_initial=1, wait_max=1, wait_jitter=0)
    call = asyncio.ensure_future(attempts(channel, policy).result())
    await asyncio.sleep(5.5)
    assert [each.cancelled for each in channel.calls] == [False]
    await asyncio.sleep(1)
    assert [each.cancelled for each in channel.calls] == [True, False]
    assert await call == "response"
    assert [each.cancelled for each in channel.calls] == [True, True, False]


async def test_cancelled_call_cancels_its_late_attempt_too():
    channel = FakeChannel(NEVER)
    call = asyncio.ensure_future(attempts(channel, RetryPolicy(attempt_timeout=5)).result())
    await asyncio.sleep(5)
    call.cancel()
    with pytest.raises(asyncio.CancelledError):
        await call
    assert channel.calls[0].cancelled


async def test_attempts_that_certainly_did_not_run_leave_no_doubt():
    late = [DeadlineExceeded("no response by the deadline", not_executed=True) for _ in range(2)]
    channel = FakeChannel(*late, mode=Mode.IDEMPOTENT, store_id=b"")
    with pytest.raises(DeadlineExceeded) as caught:
        await attempts(channel, RetryPolicy(attempts=2, attempt_timeout=5)).result()
    assert caught.value.not_executed is True
    assert str(caught.value) == "2 attempts of at most 5 s, the last: no response by the deadline"


async def test_request_in_doubt_is_not_sent_to_a_server_that_is_no_longer_idempotent():
    channel = FakeChannel(lost(None), mode=Mode.IDEMPOTENT, store_id=b"")
    call = asyncio.ensure_future(attempts(channel).result())
    await asyncio.sleep(0.005)  # between two attempts
    channel.mode = Mode.AT_MOST_ONCE
    with pytest.raises(OutcomeUnknown, match="is not idempotent; an earlier attempt"):
        await call
    assert len(channel.sent) == 1
