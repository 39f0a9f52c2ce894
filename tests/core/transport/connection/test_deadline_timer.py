"""A plan checks each deadline in time: never early, at most half a tick late."""

import asyncio
import gc
import math
import weakref

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from taskrpc.core.callinfo import answering
from taskrpc.core.transport.connection.deadline_timer import (
    CHECK_LATE,
    TICK,
    CheckPlan,
    Deadlines,
    is_over,
)
from tests.properties import examples

RESOLUTION = 2e-9


def test_no_check_is_planned_without_calls():
    plan = CheckPlan()
    assert plan.at == math.inf
    plan.expect(3.0)
    plan.checked(3.0, math.inf, 1)
    assert plan.at == plan.threshold == math.inf


def test_check_is_planned_for_the_deadline_itself():
    plan = CheckPlan()
    plan.expect(3.0021)
    assert plan.at == 3.0021


def test_later_deadlines_and_those_within_half_a_tick_are_not_reported():
    plan = CheckPlan()
    plan.expect(3.0)
    assert plan.threshold == 3.0 - CHECK_LATE


def test_checks_are_half_a_tick_apart():
    plan = CheckPlan()
    plan.checked(1.0, 1.0001, 2)
    assert plan.at == 1.0 + CHECK_LATE


def test_check_of_very_many_calls_is_followed_by_a_longer_pause():
    plan = CheckPlan()
    plan.checked(1.0, 1.0001, 100_000)
    assert plan.at == pytest.approx(1.1)


@pytest.mark.parametrize("now", [0.0, 1e3, 4e6])
def test_deadline_is_over_when_the_clock_is_a_nanosecond_early(now):
    assert is_over(now, now - 5e-10)
    assert not is_over(now + TICK / 10, now)


class NoCalls:
    """A connection on which no call is open."""

    check_before = math.inf

    def expiring(self):
        return ()


class AnsweredCall:
    """Stands for the record of a call."""


async def test_timer_that_a_callback_has_caused_does_not_keep_its_call_alive():
    loop = asyncio.get_running_loop()
    deadlines, call = Deadlines(loop, NoCalls()), AnsweredCall()
    token = answering.set(call)
    deadlines.watch(loop.time() + 30)
    answering.reset(token)
    left = weakref.ref(call)
    del call, token
    gc.collect()
    assert left() is None
    deadlines.close()


class Watching(RuleBasedStateMachine):
    """Compares the plan with a simple model: a list of deadlines."""

    @initialize(start=st.sampled_from([0.0, 12345.678, 3e6]))
    def begin(self, start):
        self.now = start
        self.plan = CheckPlan()
        self.open = {}
        self.number = 0

    @rule(after=st.one_of(st.floats(0, 0.05), st.floats(0, 5), st.integers(0, 20)))
    def call(self, after):
        self.number += 1
        deadline = self.open[self.number] = self.now + after
        if deadline < self.plan.threshold:
            self.plan.expect(deadline)

    @rule(data=st.data())
    def answer(self, data):
        if self.open:
            del self.open[data.draw(st.sampled_from(sorted(self.open)))]

    @rule(step=st.one_of(st.floats(0, 0.02), st.floats(0, 3)))
    def wait(self, step):
        end = self.now + step
        while self.plan.at <= end:
            self.now = max(self.now, self.plan.at)
            self.check()
        self.now = end
        assert all(deadline + CHECK_LATE + RESOLUTION > self.now for deadline in self.open.values())

    def check(self):
        calls = len(self.open)
        for number, deadline in list(self.open.items()):
            if is_over(deadline, self.now):
                assert deadline <= self.now + RESOLUTION, "early"
                del self.open[number]
        self.plan.checked(self.now, min(self.open.values(), default=math.inf), calls)
        assert self.plan.at >= self.now + CHECK_LATE


TestWatching = Watching.TestCase
TestWatching.settings = settings(max_examples=examples(80), stateful_step_count=40)
