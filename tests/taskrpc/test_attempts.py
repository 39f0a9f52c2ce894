"""One call over a channel that fails as it is told: what is sent again, and at what cost."""

import asyncio

import pytest

from taskrpc.attempts import FREE_SENDINGS, Attempts
from taskrpc.errors import ConnectionLost
from taskrpc.retry import RetryBudget, RetryPolicy
from taskrpc.transport.base import Mode
from taskrpc.wire.once import Numbers

AT_ONCE = RetryPolicy(wait_initial=0.01, wait_max=0.01, wait_jitter=0)


class Sent:
    """A call that was sent and has its outcome already."""

    numbers, sequence = None, 0

    def __init__(self, outcome):
        self.future = asyncio.get_running_loop().create_future()
        if isinstance(outcome, BaseException):
            self.future.set_exception(outcome)
        else:
            self.future.set_result(outcome)


class FakeChannel:
    """Gives each sending the next of these outcomes."""

    ready = True
    service_name = "/add"

    def __init__(self, *outcomes, mode=Mode.EXACTLY_ONCE, store_id=b"S" * 16):
        self.outcomes = list(outcomes)
        self.mode, self.store_id = mode, store_id
        self.sent = []

    def numbers(self):
        return Numbers(b"C" * 16, self.store_id)

    def send(self, request, deadline, number):
        self.sent.append(number)
        return Sent(self.outcomes.pop(0))


def attempts(channel, policy=AT_ONCE, budget=None, timeout=600.0):
    loop = asyncio.get_running_loop()
    budget = budget or RetryBudget()
    return Attempts(channel, "request", loop.time() + timeout, policy, budget, loop.time)


def lost():
    return ConnectionLost("lost", not_executed=False)


@pytest.mark.parametrize("losses", [1, FREE_SENDINGS, FREE_SENDINGS + 1, FREE_SENDINGS + 3])
async def test_exactly_once_call_survives_eight_lost_connections_without_the_budget(losses):
    assert FREE_SENDINGS == 8
    channel, budget = FakeChannel(*[lost() for _ in range(losses)], "response"), RetryBudget()
    assert await attempts(channel, budget=budget).result() == "response"
    assert [number.sequence for number in channel.sent] == [1] * (losses + 1)
    assert budget.booked == max(0, losses - 8)


async def test_idempotent_call_takes_every_retry_from_the_budget():
    channel = FakeChannel(lost(), lost(), "response", mode=Mode.IDEMPOTENT, store_id=b"")
    budget = RetryBudget()
    assert await attempts(channel, budget=budget).result() == "response"
    assert budget.booked == 2
