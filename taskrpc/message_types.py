"""Static types for service and message classes, and checks of the classes that a program passes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:  # defaults need Python 3.13's typing; type checkers include typing_extensions
    from typing_extensions import TypeVar
else:
    from typing import TypeVar


class Msg(Protocol):
    """What type checkers require of a message class; service classes do not fit."""

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return each field's name and its type in rosidl's spelling."""


# With the bounds, pyright reports a callback that returns None, even one without annotations.
# With the defaults, programs can annotate with `Client` alone, also under `mypy --strict`.
if TYPE_CHECKING:
    MsgT = TypeVar("MsgT", bound=Msg, default=Any)
    RequestT = TypeVar("RequestT", bound=Msg, default=Any)
    ResponseT = TypeVar("ResponseT", bound=Msg, default=Any)
    GoalT = TypeVar("GoalT", bound=Msg, default=Any)
    ResultT = TypeVar("ResultT", bound=Msg, default=Any)
    FeedbackT = TypeVar("FeedbackT", bound=Msg, default=Any)
else:
    MsgT = TypeVar("MsgT", bound=Msg)
    RequestT = TypeVar("RequestT", bound=Msg)
    ResponseT = TypeVar("ResponseT", bound=Msg)
    GoalT = TypeVar("GoalT", bound=Msg)
    ResultT = TypeVar("ResultT", bound=Msg)
    FeedbackT = TypeVar("FeedbackT", bound=Msg)


class Srv(Protocol[RequestT, ResponseT]):
    """What type checkers require of a service class: `type[Srv[RequestT, ResponseT]]`.

    The classes of `srvgen generate` and `srvgen stubs` fit. The name is rclpy's.
    """

    # A protocol cannot match names nested in a class, such as `Request: TypeAlias`. Each type
    # variable is a parameter and a result, so that no checker widens it to a common base.
    def _types(self, request: RequestT, response: ResponseT) -> tuple[RequestT, ResponseT]: ...


class Action(Protocol[GoalT, ResultT, FeedbackT]):
    """What type checkers require of an action class: `type[Action[GoalT, ResultT, FeedbackT]]`.

    The classes of `srvgen generate` and `srvgen stubs` fit.
    """

    def _types(
        self, goal: GoalT, result: ResultT, feedback: FeedbackT
    ) -> tuple[GoalT, ResultT, FeedbackT]: ...


def service_type(srv_type: Any) -> Any:
    """Return the class if it is a service type. Raises TypeError."""
    if not (hasattr(srv_type, "Request") and hasattr(srv_type, "_HASH")):
        raise _wrong("a service type such as srvgen.load('std_srvs/srv/Trigger')", srv_type)
    return srv_type


def message_type(msg_type: Any) -> Any:
    """Return the class if it is a message type. Raises TypeError."""
    is_no_message = hasattr(msg_type, "Request") or hasattr(msg_type, "Goal")
    if is_no_message or not hasattr(msg_type, "_HASH"):
        raise _wrong("a message type such as srvgen.load('std_msgs/msg/String')", msg_type)
    return msg_type


def action_type(given: Any) -> Any:
    """Return the class if it is an action type. Raises TypeError."""
    if not (hasattr(given, "Goal") and hasattr(given, "_HASH")):
        example = "example_interfaces/action/Fibonacci"
        raise _wrong(f"an action type such as srvgen.load('{example}')", given)
    return given


def _wrong(expected: str, given: Any) -> TypeError:
    kind = f"the class {given.__name__}" if isinstance(given, type) else repr(given)
    return TypeError(f"expected {expected}, got {kind}")
