"""Sleeping until something arrives."""

from __future__ import annotations

import threading
import time

import pytest

from taskrpc.ros.packages.rclpy._impl.execution import wakeups
from taskrpc.ros.packages.rclpy._impl.execution.wakeups import Sleep


def test_a_wakeup_before_the_sleep_is_not_lost():
    sleep = Sleep()
    seen = sleep.state
    sleep.end()
    sleep.until_ended(seen, None)
    assert not sleep._sleepers


def test_a_sleep_without_wakeup_ends_at_its_timeout():
    sleep = Sleep()
    sleep.until_ended(sleep.state, 0.001)
    sleep.until_ended(sleep.state, 0)
    assert not sleep._sleepers


@pytest.mark.real_time
@pytest.mark.parametrize("slice_", [None, 0.001])
@pytest.mark.parametrize("seconds", [None, 20])
def test_all_sleeping_threads_are_woken(monkeypatch, slice_, seconds):
    monkeypatch.setattr(wakeups, "_SLICE", slice_)
    sleep = Sleep()
    threads = [
        threading.Thread(target=sleep.until_ended, args=(sleep.state, seconds)) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    while len(sleep._sleepers) < 3:
        time.sleep(0.001)
    time.sleep(0.005)
    sleep.end()
    for thread in threads:
        thread.join(5)
        assert not thread.is_alive()


@pytest.mark.real_time
def test_no_end_is_lost_however_the_threads_take_turns():
    sleep, rounds, told = Sleep(), 2000, []

    def listen():
        heard = 0
        while heard < rounds:
            seen = sleep.state
            if len(told) > heard:
                heard = len(told)
            else:
                sleep.until_ended(seen, None)

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    for number in range(rounds):
        told.append(number)
        sleep.end()
    listener.join(10)
    assert not listener.is_alive()
