"""Action servers, which taskrpc does not have yet."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any

from .._impl.reexports import names_of
from .client import lacks, refuse


class GoalResponse(Enum):
    """Whether a server accepts a goal."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """Whether a server accepts a cancellation."""

    REJECT = 1
    ACCEPT = 2


class ActionServer:
    """Would execute goals of action clients; in taskrpc, no goals arrive."""

    def __init__(
        self,
        node: Any,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[..., Any],
        **settings: Any,
    ) -> None:
        lacks(f"ActionServer({action_name!r})")

    def register_handle_accepted_callback(self, callback: Callable[..., Any] | None) -> None:
        """Do nothing: no goals arrive."""

    def register_goal_callback(self, callback: Callable[..., Any] | None) -> None:
        """Do nothing: no goals arrive."""

    def register_cancel_callback(self, callback: Callable[..., Any] | None) -> None:
        """Do nothing: no goals arrive."""

    def register_execute_callback(self, callback: Callable[..., Any]) -> None:
        """Do nothing: no goals arrive."""

    def destroy(self) -> None:
        """Do nothing: there is nothing to release."""


class ServerGoalHandle:
    """Would represent a goal that is being executed; raises NotImplementedError."""

    def __init__(self, *args: Any) -> None:
        refuse("ServerGoalHandle")


__getattr__ = names_of(
    __name__, __package__, {"action_msgs/msg": "GoalInfo GoalStatus", "..future": "Future"}
)
