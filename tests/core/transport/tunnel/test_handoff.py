"""Calls from threads arrive on the event loop in order, with one wake-up for many."""

import asyncio
import threading

import pytest

from taskrpc.core.transport.tunnel.handoff import Handoff


@pytest.mark.real_time
async def test_actions_of_a_thread_run_in_order_on_the_loop():
    seen, done = [], asyncio.Event()
    handoff = Handoff(asyncio.get_running_loop())

    def work():
        for number in range(1000):
            handoff.put(lambda number: seen.append((number, threading.get_ident())), number)
        handoff.put(done.set)

    threading.Thread(target=work).start()
    await done.wait()
    assert seen == [(number, threading.get_ident()) for number in range(1000)]


async def test_many_actions_wake_the_loop_once(monkeypatch):
    loop, woken = asyncio.get_running_loop(), []
    monkeypatch.setattr(
        loop, "call_soon_threadsafe", lambda action: woken.append(loop.call_soon(action))
    )
    seen, handoff = [], Handoff(loop)
    for number in range(5):
        handoff.put(seen.append, number)
    await asyncio.sleep(0)
    assert (len(woken), seen) == (1, [0, 1, 2, 3, 4])


async def test_action_that_raises_does_not_stop_the_others():
    loop, reported, seen = asyncio.get_running_loop(), [], []
    loop.set_exception_handler(lambda _, context: reported.append(context["message"]))
    handoff = Handoff(loop)
    handoff.put(lambda: 1 / 0)
    handoff.put(seen.append, "next")
    await asyncio.sleep(0)
    assert (reported, seen) == (["a callback of a middleware failed"], ["next"])


async def test_closed_handoff_drops_actions():
    seen, handoff = [], Handoff(asyncio.get_running_loop())
    handoff.put(seen.append, 1)
    handoff.close()
    handoff.put(seen.append, 2)
    await asyncio.sleep(0)
    assert seen == []


async def test_calls_that_arrive_together_have_one_turn():
    loop = asyncio.get_running_loop()
    handoff, turns = Handoff(loop), []
    for _ in range(2):
        handoff.put(lambda: turns.append(handoff.turn))
        handoff.put(lambda: turns.append(handoff.turn))
        await asyncio.sleep(0)
    assert turns == [1, 1, 2, 2]
