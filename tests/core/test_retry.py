"""Waits are what the policy says, and retries never multiply an outage."""

import heapq
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.retry import RetryBudget, RetryPolicy, reconnect_delay

chances = st.floats(0, 1, exclude_max=True)


def test_the_lectures_backoff_is_one_two_four():
    policy = RetryPolicy(attempts=3, wait_initial=1, wait_max=8, wait_jitter=0)
    assert [policy.wait(n, 0.7) for n in range(5)] == [1, 2, 4, 8, 8]
    assert [policy.allows(n) for n in (1, 2, 3, 4)] == [True, True, True, False]


def test_without_a_number_of_attempts_only_the_deadline_ends_a_call():
    assert RetryPolicy().allows(10**9)


@given(st.integers(0, 10**6), chances)
def test_the_default_wait_is_drawn_below_a_doubling_cap_of_two_seconds(retry, chance):
    wait = RetryPolicy().wait(retry, chance)
    assert 0 <= wait <= min(2.0, 0.05 * 2 ** min(retry, 10))
    assert wait == pytest.approx(chance * min(2.0, 0.05 * 2 ** min(retry, 10)))


@given(
    st.floats(0, 1e300), st.floats(0, 1e300), st.floats(1, 1e300), st.floats(0, 1),
    st.integers(0, 10**6), chances,
)  # fmt: skip
def test_every_policy_waits_between_its_certain_share_and_its_cap(
    initial, cap, base, jitter, retry, chance
):
    policy = RetryPolicy(wait_initial=initial, wait_max=cap, wait_exp_base=base, wait_jitter=jitter)
    wait = policy.wait(retry, chance)
    assert 0 <= wait <= cap * (1 + 1e-9)
    assert policy.wait(retry, 0) <= wait
    assert policy.wait(retry, chance) <= policy.wait(retry + 1, chance) * (1 + 1e-9)
    if initial == 0:
        assert wait == 0


def test_jitter_is_the_share_that_is_drawn():
    policy = RetryPolicy(wait_initial=1, wait_max=1, wait_jitter=0.25)
    assert policy.wait(0, 0.0) == pytest.approx(0.75)
    assert policy.wait(0, 0.5) == pytest.approx(0.875)


@pytest.mark.parametrize(
    ("setting", "value", "expected"),
    [
        ("attempts", 0, "a whole number from 1 or None, got 0"),
        ("attempts", 2.5, "a whole number from 1 or None, got 2.5"),
        ("attempts", "3", "a whole number from 1 or None, got '3'"),
        ("attempts", True, "a whole number from 1 or None, got True"),
        ("attempt_timeout", True, "finite seconds above 0, or None, got True"),
        ("wait_initial", False, "finite seconds from 0, got False"),
        ("wait_max", True, "finite seconds from 0, got True"),
        ("wait_exp_base", True, "a finite number from 1, got True"),
        ("wait_jitter", True, "a share from 0 to 1, got True"),
        ("wait_initial", -1, "finite seconds from 0, got -1"),
        ("wait_initial", math.nan, "finite seconds from 0, got nan"),
        ("wait_max", -0.1, "finite seconds from 0, got -0.1"),
        ("wait_max", math.inf, "finite seconds from 0, got inf"),
        ("wait_max", "2", "finite seconds from 0, got '2'"),
        ("wait_exp_base", 0.5, "a finite number from 1, got 0.5"),
        ("wait_exp_base", None, "a finite number from 1, got None"),
        ("wait_jitter", 1.5, "a share from 0 to 1, got 1.5"),
        ("wait_jitter", -0.5, "a share from 0 to 1, got -0.5"),
        ("wait_jitter", math.nan, "a share from 0 to 1, got nan"),
    ],
)
def test_setting_out_of_range_is_named(setting, value, expected):
    with pytest.raises(ValueError, match=setting) as caught:
        RetryPolicy(**{setting: value})
    assert str(caught.value) == f"{setting}: expected {expected}"


def attempts_under_total_failure(calls_a_second, seconds, timeout, wait):
    """How often calls are tried of which none succeeds, each as often as it may."""
    budget = RetryBudget()
    calls = int(calls_a_second * seconds)
    due = [(n / calls_a_second, n, n / calls_a_second + timeout) for n in range(calls)]
    heapq.heapify(due)
    attempts = 0
    while due:
        now, call, latest = heapq.heappop(due)
        if now > seconds:
            break
        attempts += 1
        delay = budget.book(now, wait, latest)
        if delay is not None:
            assert delay >= wait
            assert now + delay < latest + 1e-9
            heapq.heappush(due, (now + delay, call, latest))
    return calls, attempts


@pytest.mark.parametrize("wait", [0.0, 0.05, 2.0])
@pytest.mark.parametrize("calls_a_second", [0.5, 5, 100])
def test_an_outage_of_a_minute_is_not_multiplied(calls_a_second, wait):
    calls, attempts = attempts_under_total_failure(calls_a_second, 60, 10, wait)
    assert attempts <= 1.10 * calls + 3 * 60 + 10
    if calls_a_second > 0.5 and wait < 1:
        assert attempts > calls + 150, "the floor is not used"


def test_retries_below_the_budget_wait_only_as_long_as_the_policy_says():
    budget = RetryBudget()
    assert [budget.book(0.0, 0.5, math.inf) for _ in range(10)] == [0.5] * 10
    spaced = [budget.book(0.0, 0.5, math.inf) for _ in range(6)]
    assert spaced == pytest.approx([0.5, 2 / 3, 1, 4 / 3, 5 / 3, 2])


def test_ten_successes_earn_one_retry():
    budget = RetryBudget()
    for _ in range(10):
        budget.book(0.0, 0.0, math.inf)
    for _ in range(11):  # one more than ten for the rounding of tenths
        budget.earn()
    assert budget.book(0.0, 0.0, math.inf) == 0.0
    assert budget.book(0.0, 0.0, math.inf) > 0.0


def test_a_long_success_earns_no_more_than_the_burst():
    budget = RetryBudget()
    for _ in range(10_000):
        budget.earn()
    assert [budget.book(0.0, 0.0, math.inf) for _ in range(11)].count(0.0) == 10


def test_retry_after_the_deadline_is_not_booked():
    budget = RetryBudget()
    assert budget.book(5.0, 1.0, 6.0) is None
    for _ in range(10):
        assert budget.book(5.0, 0.0, 6.0) == 0.0
    assert budget.book(5.0, 0.0, 5.1) is None
    assert budget.book(5.0, 2.0, 6.0) is None
    assert budget.book(5.0, 0.0, 6.0) == pytest.approx(1 / 3)


def test_a_long_wait_of_one_call_does_not_delay_the_others():
    budget = RetryBudget()
    for _ in range(10):
        budget.book(0.0, 0.0, math.inf)
    assert budget.book(0.0, 60.0, math.inf) == 60.0
    assert budget.book(0.0, 0.0, math.inf) == pytest.approx(2 / 3)


@given(st.integers(0, 10**6), chances)
def test_reconnecting_waits_between_half_and_all_of_a_growing_cap(failures, chance):
    cap = min(5.0, 0.05 * 1.6 ** min(failures, 20))
    assert cap / 2 <= reconnect_delay(failures, chance) <= cap
    assert reconnect_delay(failures, chance) <= reconnect_delay(failures + 1, chance)


def test_reconnecting_waits_between_half_and_all_of_its_cap_by_chance():
    assert [reconnect_delay(0, chance) for chance in (0.0, 0.5, 1.0)] == pytest.approx(
        [0.025, 0.0375, 0.05]
    )
    assert [reconnect_delay(failures, 1.0) for failures in (1, 2)] == pytest.approx([0.08, 0.128])


def test_budget_counts_its_retries():
    budget = RetryBudget()
    assert budget.booked == 0
    for count in range(1, 13):  # ten while it is full, two at the floor
        budget.book(0.0, 0.0, math.inf)
        assert budget.booked == count
    assert budget.book(0.0, 0.0, 0.0) is None
    assert budget.booked == 12


def test_retry_at_the_floor_must_begin_before_the_deadline():
    budget = RetryBudget()
    for _ in range(10):
        budget.book(0.0, 0.0, math.inf)
    assert budget.book(0.0, 0.0, 1 / 3) is None
    assert budget.book(0.0, 0.0, 0.334) == pytest.approx(1 / 3)


def test_one_attempt_is_a_valid_policy():
    policy = RetryPolicy(attempts=1)
    assert policy.allows(1)
    assert not policy.allows(2)
