"""A timer keeps its intervals, whatever its callback does."""

import asyncio

import pytest

import taskrpc


@pytest.fixture
async def node():
    async with taskrpc.Node("clock", transport="memory") as node:
        yield node


def instants():
    """A list of the loop's time at each call, and the callback that fills it."""
    loop, seen = asyncio.get_running_loop(), []
    began = loop.time()
    return seen, lambda: seen.append(round(loop.time() - began, 6))


async def test_timer_calls_at_even_intervals_and_first_after_one(node):
    seen, note = instants()
    node.create_timer(0.25, note)
    await asyncio.sleep(1.1)
    assert seen == [0.25, 0.5, 0.75, 1.0]


async def test_calls_that_are_due_while_a_call_runs_are_skipped(node):
    seen, note = instants()

    async def slow():
        note()
        await asyncio.sleep(0.25)

    node.create_timer(0.1, slow)
    await asyncio.sleep(1.05)
    assert seen == [0.1, 0.4, 0.7, 1.0]


async def test_cancelled_timer_stops_until_it_is_reset(node):
    seen, note = instants()
    timer = node.create_timer(0.2, note)
    await asyncio.sleep(0.5)
    timer.cancel()
    assert timer.is_canceled
    await asyncio.sleep(1.0)
    timer.reset()
    assert not timer.is_canceled
    await asyncio.sleep(0.3)
    assert seen == [0.2, 0.4, 1.7]


async def test_timer_and_its_running_call_end_with_the_node():
    ended = []

    async def waits():
        try:
            await asyncio.sleep(100)
        except asyncio.CancelledError:
            ended.append("cancelled")
            raise

    async with taskrpc.Node("clock", transport="memory") as node:
        timer = node.create_timer(0.1, waits)
        await asyncio.sleep(0.15)
    await asyncio.sleep(0)
    assert ended == ["cancelled"]
    timer.reset()
    assert timer.is_canceled


async def test_an_exception_is_logged_and_the_next_call_comes(node, caplog):
    seen, note = instants()

    def shaky():
        note()
        raise RuntimeError("this one")

    node.create_timer(0.1, shaky)
    await asyncio.sleep(0.25)
    assert seen == [0.1, 0.2]
    assert "this one" in caplog.text


@pytest.mark.parametrize("period", [-1, float("inf"), float("nan"), "1"])
async def test_a_period_is_a_number_of_seconds(node, period):
    with pytest.raises(ValueError, match="period: expected seconds, at least 0"):
        node.create_timer(period, print)
