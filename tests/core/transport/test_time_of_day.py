"""The time of day is the machine's, or that of a loop with a seed."""

import time

import pytest

from taskrpc.core.transport.time_of_day import time_of_day, time_of_day_ns
from taskrpc.testing import VirtualTimeLoop

BEGIN = 1_767_225_600  # 2026-01-01 00:00 UTC


@pytest.fixture
def machine(monkeypatch):
    monkeypatch.setattr(time, "time", lambda: 5.0)
    monkeypatch.setattr(time, "time_ns", lambda: 5_000_000_001)


def test_time_of_day_passes_with_the_clock_of_a_loop_with_a_seed(machine):
    async def read():
        return time_of_day(), time_of_day_ns()

    loop = VirtualTimeLoop(7)
    try:
        assert loop.run_until_complete(read()) == (BEGIN, BEGIN * 10**9)
        loop.advance(1.5)
        assert loop.run_until_complete(read()) == (BEGIN + 1.5, BEGIN * 10**9 + 1_500_000_000)
    finally:
        loop.close()


async def test_loop_without_a_seed_has_the_machines_time(machine):
    assert (time_of_day(), time_of_day_ns()) == (5.0, 5_000_000_001)


def test_outside_of_a_loop_the_time_is_the_machines(machine):
    assert (time_of_day(), time_of_day_ns()) == (5.0, 5_000_000_001)
