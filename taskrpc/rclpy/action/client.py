"""Action clients, which taskrpc does not have yet."""

from __future__ import annotations

import sys
import time
from typing import Any, NoReturn

from .._impl.reexports import names_of

_INSTEAD = (
    "taskrpc has no actions yet; use a service for the goal and a topic for its feedback,"
    " or the task server (`taskrpc-server`)"
)
_POLL_INTERVAL = 0.1
_warned: set[str] = set()
"""The objects about which `lacks` has printed its line."""


def refuse(what: str) -> NoReturn:
    """Raise NotImplementedError with the alternative."""
    raise NotImplementedError(f"{what}: {_INSTEAD}")


def lacks(what: str) -> None:
    """Print once that the object does nothing; the rest of the program can still work."""
    if what not in _warned and sys.stderr is not None:
        _warned.add(what)
        print(f"[taskrpc] {what} does nothing here: {_INSTEAD}", file=sys.stderr, flush=True)


class ActionClient:
    """Would send goals to an action server; taskrpc has none."""

    def __init__(self, node: Any, action_type: Any, action_name: str, **settings: Any) -> None:
        self._node = node
        self._name = f"ActionClient({action_name!r})"
        lacks(self._name)

    def server_is_ready(self) -> bool:
        """Whether there is an action server; always False."""
        return False

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Sleep `timeout_sec` seconds and return False; NotImplementedError without a timeout."""
        if timeout_sec is None or timeout_sec < 0:
            refuse(f"{self._name}.wait_for_server()")
        end = time.monotonic() + timeout_sec
        while (left := end - time.monotonic()) > 0 and self._node.context.ok():
            time.sleep(min(left, _POLL_INTERVAL))
        return False

    def send_goal(self, goal: Any, **settings: Any) -> NoReturn:
        """Would send a goal and wait for its result; raises NotImplementedError."""
        refuse(f"{self._name}.send_goal()")

    def send_goal_async(self, goal: Any, **settings: Any) -> NoReturn:
        """Would send a goal; raises NotImplementedError."""
        refuse(f"{self._name}.send_goal_async()")

    def destroy(self) -> None:
        """Do nothing: there is nothing to release."""


class ClientGoalHandle:
    """Would represent a goal that a server has accepted; raises NotImplementedError."""

    def __init__(self, *args: Any) -> None:
        refuse("ClientGoalHandle")


__getattr__ = names_of(
    __name__,
    __package__,
    {
        "action_msgs/msg": "GoalStatus",
        "action_msgs/srv": "CancelGoal",
        "unique_identifier_msgs/msg": "UUID",
        "..future": "Future",
    },
)
