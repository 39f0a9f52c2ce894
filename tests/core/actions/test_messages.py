"""Goal ids and states, as users write them and as messages carry them."""

import pytest

import srvgen
from taskrpc.actions.goals import GoalRecord
from taskrpc.actions.messages import (
    ActionMessages,
    bytes_of,
    nanoseconds_of,
    parse_goal_id,
    states_in,
)
from taskrpc.actions.states import GoalState

TEXT = "0123456789abcdef0123456789abcdef"


@pytest.fixture(scope="module")
def messages():
    return ActionMessages(srvgen.load("example_interfaces/action/Fibonacci"))


def test_ids_and_instants_survive_their_messages(messages):
    goal_id = bytes.fromhex(TEXT)
    info = messages.goal_info(goal_id, 1_500_000_000_123_456_789)
    assert bytes_of(info.goal_id) == goal_id
    assert nanoseconds_of(info.stamp) == 1_500_000_000_123_456_789
    assert srvgen.from_cdr(type(info), srvgen.to_cdr(info)) == info


def test_states_survive_their_message_and_unknown_ones_are_left_out(messages):
    goals = [
        GoalRecord(bytes([number]) * 16, None, number, state)
        for number, state in enumerate(GoalState)
    ]
    message = messages.statuses(goals)
    assert states_in(message) == {goal.goal_id: goal.state for goal in goals}
    message.status_list[0].status = 99
    assert len(states_in(message)) == len(goals) - 1


@pytest.mark.parametrize("text", [TEXT, TEXT.upper(), "01234567-89ab-cdef-0123-456789abcdef"])
def test_a_goal_id_may_be_written_in_all_forms_of_a_uuid(text):
    assert parse_goal_id(text) == bytes.fromhex(TEXT)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "expected a UUID of 32 hexadecimal digits, got ''"),
        ("order 66", "expected a UUID of 32 hexadecimal digits, got 'order 66'"),
        (7, "expected a UUID of 32 hexadecimal digits, got 7"),
        ("0" * 32, "expected a UUID other than zero, which means all goals"),
    ],
)
def test_other_goal_ids_are_refused_with_what_was_expected(text, problem):
    with pytest.raises(ValueError, match=problem):
        parse_goal_id(text)
