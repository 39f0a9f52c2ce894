"""The names of an action's services and topics, and of an action's types.

The action `/fibonacci` consists of the services `/fibonacci/_action/send_goal`, `cancel_goal` and
`get_result`, and of the topics `/fibonacci/_action/feedback` and `status`. ROS has the same names.
"""

from __future__ import annotations

import msgspec

_INFIX = "/_action/"
_FEEDBACK = "feedback"
_FEEDBACK_TYPE = "_FeedbackMessage"


class ActionNames(msgspec.Struct, frozen=True):
    """The names of the services and topics of one action; made by `names_of`."""

    action: str
    send_goal: str
    """A service: sends a goal; the server accepts or rejects it."""
    cancel_goal: str
    """A service: cancels one goal or several."""
    get_result: str
    """A service: responds when a goal has ended."""
    feedback: str
    """A topic: the feedback of all goals."""
    status: str
    """A topic: the states of all goals, latched."""

    @property
    def services(self) -> tuple[str, str, str]:
        """The names of the three services."""
        return self.send_goal, self.cancel_goal, self.get_result

    @property
    def topics(self) -> tuple[str, str]:
        """The names of the two topics."""
        return self.feedback, self.status


def names_of(action: str) -> ActionNames:
    """Return the names of an action's services and topics; relative if `action` is relative."""
    prefix = f"{action}{_INFIX}"
    return ActionNames(
        action=action,
        send_goal=f"{prefix}send_goal",
        cancel_goal=f"{prefix}cancel_goal",
        get_result=f"{prefix}get_result",
        feedback=f"{prefix}{_FEEDBACK}",
        status=f"{prefix}status",
    )


def action_of_feedback(topic: str, type_name: str) -> tuple[str, str] | None:
    """Return the name and the type of the action that a topic carries the feedback of.

    Returns None for any other topic. A process that publishes such a topic has an action server;
    one that subscribes to it has an action client.
    """
    name, infix, last = topic.rpartition(_INFIX)
    if not (name and infix and last == _FEEDBACK and type_name.endswith(_FEEDBACK_TYPE)):
        return None
    return name, type_name.removesuffix(_FEEDBACK_TYPE)
