"""The ledger of goals, against a simple model, and the rules of a request to cancel."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from taskrpc.actions import goals
from taskrpc.actions.goals import CancelCode, GoalLedger, GoalRecord, goals_to_cancel
from taskrpc.actions.states import ENDED, TRANSITIONS, GoalEvent, GoalState, InvalidTransition
from taskrpc.errors import Code, HandlerFailed

KEEP = 10.0
ENDINGS = [GoalEvent.SUCCEED, GoalEvent.ABORT, GoalEvent.CANCELED]


def key(number):
    return number.to_bytes(16, "big")


class LedgerMachine(RuleBasedStateMachine):
    """Any order of requests, events and time: the ledger agrees with a plain dict of goals."""

    def __init__(self):
        super().__init__()
        self.ledger = GoalLedger(KEEP)
        self.now = 0.0
        self.states = {}
        self.expiry = {}

    @rule(number=st.integers(1, 6), accepts=st.booleans())
    def send(self, number, accepts):
        if self.ledger.find(key(number)) is not None:
            with pytest.raises(ValueError, match="is known already"):
                self.ledger.accept(key(number), "goal", 0)
            return
        if accepts:
            self.ledger.accept(key(number), "goal", int(self.now))
            self.states[number] = GoalState.ACCEPTED
        else:
            self.ledger.reject(key(number), "goal", int(self.now), self.now, None)
            self.states[number] = GoalState.UNKNOWN
            self.expiry[number] = self.now + KEEP

    @precondition(lambda self: self.states)
    @rule(data=st.data())
    def event(self, data):
        number = data.draw(st.sampled_from(sorted(self.states)))
        event = data.draw(st.sampled_from(GoalEvent))
        goal = self.ledger.find(key(number))
        following = TRANSITIONS.get((self.states[number], event))
        ends = event in ENDINGS
        if following is None:
            with pytest.raises(InvalidTransition):
                self.ledger.end(goal, event, self.now) if ends else goal.change(event)
            return
        if ends:
            self.ledger.end(goal, event, self.now, result=number)
            self.expiry[number] = self.now + KEEP
        else:
            goal.change(event)
        self.states[number] = following

    @rule(seconds=st.floats(0, KEEP))
    def wait(self, seconds):
        self.now += seconds
        expired = {number for number, expiry in self.expiry.items() if expiry <= self.now}
        assert {goal.goal_id for goal in self.ledger.expire(self.now)} == set(map(key, expired))
        for number in expired:
            del self.expiry[number], self.states[number]

    @invariant()
    def agrees(self):
        ledger = self.ledger
        assert len(ledger) == len(self.states)
        for number in range(1, 7):
            goal = ledger.find(key(number))
            assert (None if goal is None else goal.state) == self.states.get(number)
            if goal is not None and goal.state in ENDED:
                assert goal.result == number
        assert ledger.next_expiry == min(self.expiry.values(), default=None)
        active = {key(n) for n, state in self.states.items() if state.is_active}
        assert {goal.goal_id for goal in ledger.active()} == active
        rejected = {n for n, state in self.states.items() if state is GoalState.UNKNOWN}
        assert set(ledger.accepted) == {key(n) for n in self.states if n not in rejected}


TestLedger = LedgerMachine.TestCase


def test_an_event_that_does_not_end_a_goal_is_refused_as_its_end():
    ledger = GoalLedger(KEEP)
    goal = ledger.accept(key(1), None, 0)
    with pytest.raises(ValueError, match="EXECUTE does not end a goal"):
        ledger.end(goal, GoalEvent.EXECUTE, 0.0)
    assert goal.state is GoalState.ACCEPTED


def test_a_rejected_goal_keeps_its_reason():
    ledger, error = GoalLedger(KEEP), HandlerFailed(Code.NOT_FOUND, "no such place")
    assert ledger.reject(key(1), None, 5, 0.0, error).is_rejected
    assert ledger.find(key(1)).error is error
    assert not ledger.accepted


def test_with_too_many_goals_the_ledger_forgets_the_oldest_that_have_ended(monkeypatch):
    monkeypatch.setattr(goals, "MOST_KEPT", 2)
    ledger = GoalLedger(KEEP)
    active = ledger.accept(key(9), None, 0)
    for number in (1, 2, 3):
        goal = ledger.accept(key(number), None, 0)
        goal.change(GoalEvent.EXECUTE)
        ledger.end(goal, GoalEvent.SUCCEED, float(number))
    assert ledger.find(key(1)) is None
    assert ledger.find(key(2)) is not None
    assert ledger.find(key(9)) is active


# Which goals a request to cancel means

ACTIVE, ENDING, DONE = GoalState.EXECUTING, GoalState.CANCELING, GoalState.SUCCEEDED
GOALS = {
    key(number): GoalRecord(key(number), None, stamp, state)
    for number, stamp, state in [(1, 10, ACTIVE), (2, 20, ACTIVE), (3, 30, ENDING), (4, 5, DONE)]
}


@pytest.mark.parametrize(
    ("number", "stamp", "code", "expected"),
    [
        (1, 0, CancelCode.NONE, [1]),
        (3, 0, CancelCode.GOAL_TERMINATED, []),
        (4, 0, CancelCode.GOAL_TERMINATED, []),
        (9, 0, CancelCode.UNKNOWN_GOAL_ID, []),
        (0, 0, CancelCode.NONE, [1, 2]),
        (0, 10, CancelCode.NONE, [1]),
        (0, 9, CancelCode.NONE, []),
        (2, 10, CancelCode.NONE, [1, 2]),
        (9, 10, CancelCode.NONE, [1]),
    ],
)
def test_a_cancel_request_selects_the_same_goals_as_in_ros(number, stamp, code, expected):
    found, named = goals_to_cancel(GOALS, key(number), stamp)
    assert (found, [goal.goal_id for goal in named]) == (code, [key(n) for n in expected])


@given(
    st.dictionaries(st.integers(1, 5), st.tuples(st.integers(1, 5), st.sampled_from(GoalState))),
    st.integers(0, 6),
    st.integers(0, 6),
)
def test_only_goals_that_can_be_cancelled_are_cancelled(table, number, stamp):
    records = {
        key(n): GoalRecord(key(n), None, accepted, state) for n, (accepted, state) in table.items()
    }
    code, named = goals_to_cancel(records, key(number), stamp)
    assert all(goal.state.is_cancelable for goal in named)
    assert code is CancelCode.NONE or not named
