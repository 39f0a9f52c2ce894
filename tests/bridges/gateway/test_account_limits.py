"""How many calls of one account reach the robot."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.bridges.gateway import AccountLimits


def test_account_may_begin_a_second_of_calls_at_once_and_then_waits():
    limits = AccountLimits(rate=2, in_flight=9)
    assert [limits.begin("eva", 0.0) for _ in range(3)] == [0.0, 0.0, 0.5]
    assert limits.begin("eva", 0.25) == pytest.approx(0.25)
    assert limits.begin("eva", 0.5) == 0.0


def test_accounts_do_not_share_their_limits():
    limits = AccountLimits(rate=1, in_flight=1)
    assert limits.begin("eva", 0.0) == 0.0
    assert limits.begin("eva", 0.0) > 0.0
    assert limits.begin("tom", 0.0) == 0.0


def test_calls_without_a_response_are_limited():
    limits = AccountLimits(rate=100, in_flight=2)
    assert [bool(limits.begin("eva", 0.0)) for _ in range(3)] == [False, False, True]
    limits.end("eva")
    assert limits.begin("eva", 0.0) == 0.0


@pytest.mark.faults
def test_idle_accounts_are_forgotten_and_busy_ones_are_not():
    limits = AccountLimits(rate=1, in_flight=1)
    limits.begin("busy", 0.0)
    for number in range(3000):
        limits.begin(f"account {number}", 0.0)
        limits.end(f"account {number}")
    limits.begin("last", 10.0)
    assert len(limits._uses) < 10
    assert limits.begin("busy", 10.0) > 0.0


@given(st.lists(st.floats(0, 0.2), min_size=1, max_size=200), st.integers(1, 20))
def test_rate_holds_over_any_time(gaps, rate):
    limits, now, begun = AccountLimits(rate=rate, in_flight=10_000), 0.0, 0
    for gap in gaps:
        now += gap
        begun += not limits.begin("eva", now)
    assert begun <= rate + now * rate + 1e-6
