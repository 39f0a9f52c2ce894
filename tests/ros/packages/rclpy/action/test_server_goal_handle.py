"""Goal handles change the states of their goals as the table allows, and end them."""

import pytest

from taskrpc.ros.packages.rclpy.action import ActionServer, CancelResponse
from taskrpc.ros.packages.rclpy.action.server import ServerGoalHandle
from taskrpc.ros.packages.rclpy.action.server_goal_handle import describe
from taskrpc.ros.packages.rclpy.exceptions import RCLError
from tests.ros.packages.rclpy.action.actions import (
    Fibonacci,
    GoalStatus,
    action,
    ended,
    order,
    result,
)

pytestmark = pytest.mark.real_time


def accept_all(_):
    return CancelResponse.ACCEPT


class Deferred:
    """Keeps the handles of accepted goals."""

    def __init__(self):
        self.handles = []

    def __call__(self, handle):
        self.handles.append(handle)


def test_a_program_can_end_a_goal_without_a_callback():
    deferred = Deferred()
    with action(None, handle_accepted_callback=deferred) as pair:
        handle = pair.send(order(1))
        deferred.handles[0].executing()
        deferred.handles[0].succeed(result(4))
        response = pair.world.answer(handle.get_result_async())
        assert ended(response) == (GoalStatus.STATUS_SUCCEEDED, [4])
        with pytest.raises(TypeError, match="not callable"):
            ActionServer(pair.served, Fibonacci, "other", None)


def test_states_change_only_as_the_table_allows():
    deferred = Deferred()
    with action(handle_accepted_callback=deferred) as pair:
        pair.send(order(1))
        [goal] = deferred.handles
        goal.executing()
        invalid = "Failed to update goal state: .* invalid transition from state EXECUTING with"
        with pytest.raises(RCLError, match=f"{invalid} event CANCELED"):
            goal.canceled()
        with pytest.raises(TypeError, match="expected a Fibonacci_Feedback, got the class"):
            goal.publish_feedback(Fibonacci.Feedback)
        goal.destroy()
        goal.succeed()
        goal.publish_feedback(Fibonacci.Feedback())
        assert (goal.status, goal.is_active) == (GoalStatus.STATUS_UNKNOWN, False)
        assert goal == goal
        assert goal != 1
        assert ServerGoalHandle[int, int, int]


def test_values_are_described_for_errors():
    assert describe(None) == "nothing"
    assert describe(5) == "a value of the type int"
    assert describe(Fibonacci) == "the class Fibonacci (write `Fibonacci()`)"
