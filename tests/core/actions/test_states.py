"""The table of a goal's states is ROS's, and nothing changes a goal that has ended."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.actions.states import (
    ACTIVE,
    ENDED,
    TRANSITIONS,
    GoalEvent,
    GoalState,
    InvalidTransition,
    next_state,
)

STATES = {
    "UNKNOWN": {},
    "ACCEPTED": {"EXECUTE": "EXECUTING", "CANCEL_GOAL": "CANCELING"},
    "EXECUTING": {"SUCCEED": "SUCCEEDED", "ABORT": "ABORTED", "CANCEL_GOAL": "CANCELING"},
    "CANCELING": {"SUCCEED": "SUCCEEDED", "ABORT": "ABORTED", "CANCELED": "CANCELED"},
    "SUCCEEDED": {},
    "CANCELED": {},
    "ABORTED": {},
}
"""The state after each allowed event, in each state, as ROS's documents show it."""


@pytest.mark.parametrize("event", GoalEvent)
@pytest.mark.parametrize("state", GoalState)
def test_each_event_changes_each_state_as_in_ros(state, event):
    following = STATES[state.name].get(event.name)
    if following is None:
        with pytest.raises(InvalidTransition) as refused:
            next_state(state, event)
        assert (refused.value.state, refused.value.event) == (state, event)
    else:
        assert next_state(state, event) is GoalState[following]
    assert state.is_cancelable == ("CANCEL_GOAL" in STATES[state.name])


def test_the_numbers_are_those_of_the_message():
    message = srvgen.load("action_msgs/msg/GoalStatus")
    for state in GoalState:
        assert getattr(message, f"STATUS_{state.name}") == state
    assert [event.value for event in GoalEvent] == [0, 1, 2, 3, 4]
    assert f"{GoalState.ACCEPTED} {GoalEvent.CANCEL_GOAL}" == "ACCEPTED CANCEL_GOAL"


def test_every_state_but_unknown_is_active_or_ended():
    assert {GoalState.UNKNOWN} == set(GoalState) - ACTIVE - ENDED
    assert not ACTIVE & ENDED
    assert GoalState.CANCELING.is_active
    assert not GoalState.UNKNOWN.is_active
    assert GoalState.ABORTED.is_ended
    assert not GoalState.UNKNOWN.is_ended


def test_error_names_the_state_the_event_and_the_allowed_events():
    with pytest.raises(
        InvalidTransition, match="the goal is ACCEPTED: expected EXECUTE or CANCEL_GOAL, got ABORT"
    ):
        next_state(GoalState.ACCEPTED, GoalEvent.ABORT)
    with pytest.raises(
        InvalidTransition, match="the goal is SUCCEEDED: expected no more events, got EXECUTE"
    ) as refused:
        next_state(GoalState.SUCCEEDED, GoalEvent.EXECUTE)
    assert str(pickle.loads(pickle.dumps(refused.value))) == str(refused.value)


@given(st.lists(st.sampled_from(GoalEvent)))
def test_goals_end_at_most_once_and_are_cancelled_only_after_a_cancellation(events):
    state, taken = GoalState.ACCEPTED, []
    for event in events:
        was_ended = state.is_ended
        try:
            state = next_state(state, event)
        except InvalidTransition:
            continue
        assert not was_ended
        taken.append(event)
    endings = {GoalEvent.SUCCEED, GoalEvent.ABORT, GoalEvent.CANCELED}
    assert [event in endings for event in taken].count(True) == state.is_ended
    assert state.is_active or taken[-1] in endings
    if state is GoalState.CANCELED:
        assert GoalEvent.CANCEL_GOAL in taken
    assert len(taken) == len(set(taken)) <= 3


def test_every_ending_can_be_reached():
    reached = {GoalState.ACCEPTED}
    for _ in GoalState:
        reached |= {TRANSITIONS[pair] for pair in TRANSITIONS if pair[0] in reached}
    assert reached == ACTIVE | ENDED
