"""Opening a session, its errors, and the hand-off from Zenoh's threads to the event loop."""

from __future__ import annotations

import asyncio
import threading

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.transport.zenoh.configuration import (
    Configuration,
    configuration_of,
    router_configuration,
)
from taskrpc.transport.zenoh.session import HandOff, open_session, reason_of


@pytest.mark.real_time
def test_a_missing_router_is_named_with_what_to_do():
    with pytest.raises(TaskRpcError) as caught:
        open_session(configuration_of(["127.0.0.1:9"]))
    assert str(caught.value) == (
        "no Zenoh router answers at tcp/127.0.0.1:9; start one there with `taskrpc router`, or"
        " give the address of yours with peers= or ZENOH_CONFIG_OVERRIDE"
    )


@pytest.mark.real_time
def test_a_taken_address_is_one_line(zenoh_router):
    with pytest.raises(TaskRpcError, match=r"cannot open a Zenoh session: .*in use") as caught:
        open_session(router_configuration(zenoh_router))
    assert ".rs:" not in str(caught.value)


@pytest.mark.parametrize(
    ("configuration", "problem"),
    [
        (Configuration("", (("mood", '"client"'),), ()), "Zenoh refuses mood="),
        (Configuration("", (("mode", "client"),), ()), "Zenoh refuses mode=client"),
        (Configuration("/nowhere.json5", (), ()), "cannot read Zenoh's configuration /nowhere"),
    ],
)
def test_an_invalid_configuration_is_refused(configuration, problem):
    with pytest.raises(TaskRpcError, match=problem):
        open_session(configuration)


def test_a_reason_is_one_line_without_places_in_the_source():
    error = ValueError("no\nway  at /build/zenoh/x.rs:12. Then " + "x" * 400)
    reason = reason_of(error)
    assert reason.startswith("no way Then x")
    assert len(reason) == 301


@pytest.mark.real_time
async def test_values_of_threads_arrive_on_the_loop_in_order():
    hand_off, got = HandOff(asyncio.get_running_loop()), []
    threads = [
        threading.Thread(
            target=lambda name=name: [hand_off.post(got.append, (name, n)) for n in range(500)]
        )
        for name in "ab"
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        await asyncio.to_thread(thread.join)
    await asyncio.sleep(0)
    assert len(got) == 1000
    for name in "ab":
        assert [n for each, n in got if each == name] == list(range(500))


async def test_a_failed_value_does_not_stop_the_next_ones():
    loop = asyncio.get_running_loop()
    hand_off, got, failures = HandOff(loop), [], []
    loop.set_exception_handler(lambda _, context: failures.append(context["exception"]))
    hand_off.post(lambda _: 1 / 0, None)
    hand_off.post(got.append, 1)
    hand_off.drain()
    assert got == [1]
    assert isinstance(failures[0], ZeroDivisionError)


async def test_a_closed_hand_off_drops_what_arrives():
    hand_off, got = HandOff(asyncio.get_running_loop()), []
    hand_off.post(got.append, 1)
    hand_off.close()
    hand_off.post(got.append, 2)
    hand_off.drain()
    assert not got
