"""Clients of actions: not yet."""

from __future__ import annotations

from typing import Any, NoReturn


def refuse(what: str) -> NoReturn:
    """Say that there are no actions, and what does the same."""
    raise NotImplementedError(
        f"{what}: taskrpc has no actions yet; use a service for the goal and a topic for its"
        " feedback, or the task server (`taskrpc-server`)"
    )


class ActionClient:
    """Would send goals to an action server."""

    def __init__(self, node: Any, action_type: Any, action_name: str, **settings: Any) -> None:
        refuse(f"ActionClient({action_name!r})")


class ClientGoalHandle:
    """Would stand for a goal that a server has accepted."""

    def __init__(self, *args: Any) -> None:
        refuse("ClientGoalHandle")
