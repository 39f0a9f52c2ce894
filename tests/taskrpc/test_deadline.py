"""The wheel is never early, at most a tick late, and forgets what is discarded."""

import math
import tracemalloc

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from taskrpc.deadline import TICK, DeadlineWheel

RESOLUTION = 2e-9


def test_an_item_expires_once_and_not_before_its_deadline():
    wheel = DeadlineWheel()
    wheel.add(1.0021, "call")
    assert wheel.expire(1.002) == []
    assert wheel.expire(1.0021 + TICK) == ["call"]
    assert wheel.expire(9.0) == []


def test_next_due_is_the_instant_at_which_expire_has_something_to_do():
    wheel = DeadlineWheel()
    assert wheel.next_due() is None
    wheel.add(7.0, "late")
    wheel.add(2.0, "soon")
    due = wheel.next_due()
    assert due == pytest.approx(2.0, abs=TICK)
    assert wheel.expire(due) == ["soon"]
    assert wheel.next_due() == pytest.approx(7.0, abs=TICK)


def test_a_discarded_item_never_expires_and_wakes_nobody():
    wheel = DeadlineWheel()
    slot = wheel.add(1.0, "call")
    wheel.discard(slot, "call")
    wheel.discard(slot, "call")
    wheel.discard(12345, "unknown")
    assert len(wheel) == 0
    assert wheel.next_due() is None
    assert wheel.expire(2.0) == []


def test_a_slot_can_be_filled_again_after_it_was_emptied():
    wheel = DeadlineWheel()
    for n in range(5000):
        wheel.discard(wheel.add(1.0, n), n)
    wheel.add(1.0, "last")
    assert wheel.expire(1.0 + TICK) == ["last"]
    assert wheel.next_due() is None


def test_what_expires_together_comes_earliest_tick_first():
    wheel = DeadlineWheel()
    for deadline in (3.0, 1.0, 2.0, 1.0):
        wheel.add(deadline, (deadline, len(wheel)))
    assert wheel.expire(5.0) == [(1.0, 1), (1.0, 3), (2.0, 2), (3.0, 0)]


@pytest.mark.parametrize("start", [0.0, 1e3, 1e6, 4e6])
def test_no_rounding_makes_a_deadline_early(start):
    wheel = DeadlineWheel()
    for n in range(2000):
        deadline = start + n * TICK / 7
        for exact in (deadline, math.nextafter(deadline, math.inf), start + n * TICK):
            wheel.add(exact, exact)
            due = wheel.next_due()
            assert exact - RESOLUTION <= due <= exact + TICK + RESOLUTION
            assert wheel.expire(due) == [exact]


def test_forgotten_deadlines_of_the_far_future_leave_nothing_behind():
    wheel = DeadlineWheel()
    held = [(wheel.add(10.0 * n, n), n) for n in range(1, 101)]
    tracemalloc.start()
    try:
        for n in range(20_000):
            wheel.discard(wheel.add(3600.0 + 10 * n * TICK, n), n)
        left, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000
    assert left < 1_000_000
    assert len(wheel) == 100
    assert wheel.expire(1e9) == [n for _, n in held]


class Wheel(RuleBasedStateMachine):
    """Against the obvious model: a list of deadlines."""

    @initialize(start=st.sampled_from([0.0, 12345.678, 3e6]))
    def begin(self, start):
        self.now = start
        self.wheel = DeadlineWheel()
        self.deadlines = {}
        self.slots = {}

    @rule(after=st.one_of(st.floats(-0.01, 0.05), st.floats(0, 5), st.integers(0, 20)))
    def add(self, after):
        item = len(self.slots)
        self.deadlines[item] = self.now + after
        self.slots[item] = self.wheel.add(self.now + after, item)

    @rule(data=st.data())
    def discard(self, data):
        if self.slots:
            item = data.draw(st.sampled_from(sorted(self.slots)))
            self.wheel.discard(self.slots[item], item)
            self.deadlines.pop(item, None)

    @rule(step=st.one_of(st.floats(0, 0.02), st.floats(0, 3)))
    def advance(self, step):
        self.now += step
        self.expire()

    @rule()
    def wake(self):
        due = self.wheel.next_due()
        if due is not None:
            self.now = max(self.now, due)
            before = len(self.deadlines)
            self.expire()
            assert len(self.deadlines) < before, "woken for nothing"

    def expire(self):
        expired = self.wheel.expire(self.now)
        assert len(expired) == len(set(expired))
        for item in expired:
            assert self.deadlines.pop(item) <= self.now + RESOLUTION, "early"
        late = [each for each in self.deadlines.values() if each + TICK + RESOLUTION < self.now]
        assert not late

    @invariant()
    def counts(self):
        if hasattr(self, "wheel"):
            assert len(self.wheel) == len(self.deadlines)


TestWheel = Wheel.TestCase
TestWheel.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
