"""Makes and reads the messages of one action type; ROS defines them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from taskrpc.actions.goals import GoalRecord
from taskrpc.actions.states import GoalState
from taskrpc.qos import QoS

FEEDBACK_QOS = QoS(depth=10)
STATUS_QOS = QoS(depth=1, durability="transient_local")
"""The QoS of the topics, as in ROS: later subscriptions get the last status too."""
_SECOND = 1_000_000_000
_STATES = {state.value: state for state in GoalState}


class ActionMessages:
    """The services and messages of one action type.

    The nested classes are those of the action's own package, which may be a generated one.
    """

    def __init__(self, action_type: Any) -> None:
        impl = action_type.Impl
        self.type_name: str = action_type._TYPE
        self.result: Any = action_type.Result
        self.send_goal: Any = impl.SendGoalService
        self.cancel_goal: Any = impl.CancelGoalService
        self.get_result: Any = impl.GetResultService
        self.feedback: Any = impl.FeedbackMessage
        self.status: Any = impl.GoalStatusMessage
        self._goal_status: Any = self.status._NESTED["status_list"]
        self._goal_info: Any = self._goal_status._NESTED["goal_info"]
        self._id: Any = self._goal_info._NESTED["goal_id"]
        self._time: Any = self._goal_info._NESTED["stamp"]

    def goal_id(self, goal_id: bytes) -> Any:
        """Return the message of a goal id."""
        return self._id(uuid=goal_id)

    def time(self, nanoseconds: int) -> Any:
        """Return the message of an instant."""
        return self._time(sec=nanoseconds // _SECOND, nanosec=nanoseconds % _SECOND)

    def goal_info(self, goal_id: bytes, stamp: int = 0) -> Any:
        """Return the message that names a goal."""
        return self._goal_info(goal_id=self.goal_id(goal_id), stamp=self.time(stamp))

    def statuses(self, goals: Iterable[GoalRecord]) -> Any:
        """Return the message with the states of goals."""
        return self.status(
            status_list=[
                self._goal_status(
                    goal_info=self.goal_info(goal.goal_id, goal.stamp), status=goal.state
                )
                for goal in goals
            ]
        )


def bytes_of(goal_id: Any) -> bytes:
    """Return the 16 bytes of the message of a goal id."""
    return bytes(goal_id.uuid)


def nanoseconds_of(stamp: Any) -> int:
    """Return the nanoseconds of the message of an instant."""
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def states_in(statuses: Any) -> dict[bytes, GoalState]:
    """Return the states of goals, by id; states that this version does not know are left out."""
    return {
        bytes_of(each.goal_info.goal_id): _STATES[each.status]
        for each in statuses.status_list
        if each.status in _STATES
    }


def parse_goal_id(text: str) -> bytes:
    """Return the 16 bytes of a goal id that a program or a user wrote.

    Raises ValueError.
    """
    try:
        parsed = UUID(text).bytes
    except (ValueError, AttributeError, TypeError):
        problem = f"goal_id: expected a UUID of 32 hexadecimal digits, got {text!r}"
        raise ValueError(problem) from None
    if not any(parsed):
        raise ValueError("goal_id: expected a UUID other than zero, which means all goals")
    return parsed
