"""Types of interface classes for annotations, and checks whether a class is an interface."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, TypeVar

from taskrpc.message_types import Action, Msg, Srv

from .exceptions import NoTypeSupportImportedException

MsgT = TypeVar("MsgT")
SrvT = TypeVar("SrvT")
SrvRequestT = TypeVar("SrvRequestT")
SrvResponseT = TypeVar("SrvResponseT")
ActionT = TypeVar("ActionT")
GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")

MsgType, SrvType = MsgT, SrvT
SrvTypeRequest, SrvTypeResponse = SrvRequestT, SrvResponseT
"""The old names, for annotations in older programs."""


class PyCapsule(Protocol):
    """An object of C that ROS keeps in interface classes, for annotations."""


class EventMessage(Msg, Protocol):
    """A message of `rclpy.service_introspection`, the class `Event` of a service."""

    info: Any


class SendGoalServiceRequest(Msg, Protocol[GoalT]):
    """A request that sends a goal to an action server."""

    goal_id: Any
    goal: GoalT


class SendGoalServiceResponse(Msg, Protocol):
    """The response to a goal."""

    accepted: bool
    stamp: Any


class GetResultServiceRequest(Msg, Protocol):
    """A request for the result of a goal."""

    goal_id: Any


class GetResultServiceResponse(Msg, Protocol[ResultT]):
    """The result of a goal with its status."""

    status: int
    result: ResultT


class FeedbackMessage(Msg, Protocol[FeedbackT]):
    """The feedback of a goal with its id."""

    goal_id: Any
    feedback: FeedbackT


SendGoalService: TypeAlias = Srv[Any, Any]
GetResultService: TypeAlias = Srv[Any, Any]


def check_for_type_support(msg_or_srv_type: Any) -> None:
    """Raise AttributeError for an object that is not an interface."""
    if isinstance(msg_or_srv_type, type) and hasattr(msg_or_srv_type, "_HASH"):
        return
    if hasattr(msg_or_srv_type, "_HASH"):
        kind = type(msg_or_srv_type).__name__
        raise AttributeError(
            f"'{kind}' object has no attribute '_TYPE_SUPPORT'."
            f" Expected the class {kind}, without () after it"
        )
    if isinstance(msg_or_srv_type, type) and hasattr(msg_or_srv_type, "_TYPE_SUPPORT"):
        raise NoTypeSupportImportedException
    if isinstance(msg_or_srv_type, type):
        what, got = f"type object '{msg_or_srv_type.__name__}'", msg_or_srv_type.__name__
    else:
        what, got = f"'{type(msg_or_srv_type).__name__}' object", repr(msg_or_srv_type)
    raise AttributeError(
        f"{what} has no attribute '_TYPE_SUPPORT'."
        f" Expected a class such as std_msgs.msg.String or std_srvs.srv.Trigger, got {got}"
    )


def check_is_valid_msg_type(msg_type: Any) -> None:
    """Raise AttributeError or RuntimeError for an object that is not a message type."""
    check_for_type_support(msg_type)
    if hasattr(msg_type, "Request"):
        raise RuntimeError(f"expected a message type, got the service {msg_type.__name__}")
    if hasattr(msg_type, "Impl"):
        raise RuntimeError(f"expected a message type, got the action {msg_type.__name__}")


def check_is_valid_srv_type(srv_type: Any) -> None:
    """Raise AttributeError or RuntimeError for an object that is not a service type."""
    check_for_type_support(srv_type)
    if not (hasattr(srv_type, "Request") and hasattr(srv_type, "Response")):
        kind = "action" if hasattr(srv_type, "Impl") else "message"
        raise RuntimeError(f"expected a service type, got the {kind} {srv_type.__name__}")


def check_is_valid_action_type(action_type: Any) -> None:
    """Raise AttributeError or RuntimeError for an object that is not an action type."""
    check_for_type_support(action_type)
    if not hasattr(action_type, "Impl"):
        kind = "service" if hasattr(action_type, "Request") else "message"
        raise RuntimeError(f"expected an action type, got the {kind} {action_type.__name__}")


__all__ = [
    "Action",
    "ActionT",
    "EventMessage",
    "FeedbackMessage",
    "FeedbackT",
    "GetResultService",
    "GetResultServiceRequest",
    "GetResultServiceResponse",
    "GoalT",
    "Msg",
    "MsgT",
    "MsgType",
    "PyCapsule",
    "ResultT",
    "SendGoalService",
    "SendGoalServiceRequest",
    "SendGoalServiceResponse",
    "Srv",
    "SrvRequestT",
    "SrvResponseT",
    "SrvT",
    "SrvType",
    "SrvTypeRequest",
    "SrvTypeResponse",
    "check_for_type_support",
    "check_is_valid_action_type",
    "check_is_valid_msg_type",
    "check_is_valid_srv_type",
]
