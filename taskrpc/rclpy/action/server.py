"""Servers of actions: not yet."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any

from .client import refuse


class GoalResponse(Enum):
    """What a server says to a goal."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """What a server says to a wish to cancel."""

    REJECT = 1
    ACCEPT = 2


class ActionServer:
    """Would work on goals of action clients."""

    def __init__(
        self,
        node: Any,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[..., Any],
        **settings: Any,
    ) -> None:
        refuse(f"ActionServer({action_name!r})")


class ServerGoalHandle:
    """Would stand for a goal that is being worked on."""

    def __init__(self, *args: Any) -> None:
        refuse("ServerGoalHandle")
