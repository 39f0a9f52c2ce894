"""Servers of actions: not yet."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any

from .._impl.reexports import names_of
from .client import lacks, refuse


class GoalResponse(Enum):
    """What a server says to a goal."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """What a server says to a wish to cancel."""

    REJECT = 1
    ACCEPT = 2


class ActionServer:
    """Would work on goals of action clients; here none come."""

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
        """Nothing: no goal comes."""

    def register_goal_callback(self, callback: Callable[..., Any] | None) -> None:
        """Nothing: no goal comes."""

    def register_cancel_callback(self, callback: Callable[..., Any] | None) -> None:
        """Nothing: no goal comes."""

    def register_execute_callback(self, callback: Callable[..., Any]) -> None:
        """Nothing: no goal comes."""

    def destroy(self) -> None:
        """Nothing: there is nothing to give up."""


class ServerGoalHandle:
    """Would stand for a goal that is being worked on."""

    def __init__(self, *args: Any) -> None:
        refuse("ServerGoalHandle")


__getattr__ = names_of(
    __name__, __package__, {"action_msgs/msg": "GoalInfo GoalStatus", "..future": "Future"}
)
