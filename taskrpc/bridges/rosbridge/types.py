"""Types by the names that clients of rosbridge use: `pkg/srv/Name`, and `pkg/Name` as in ROS 1."""

from __future__ import annotations

from typing import Any

import srvgen
from taskrpc.errors import TaskRpcError
from taskrpc.message_types import action_type, message_type, service_type


def service_class(type_name: str) -> Any:
    """Return the class of a service type, also for `pkg/Name`.

    Raises DefinitionError; TaskRpcError for a type that is not a service.
    """
    try:
        return service_type(srvgen.load(service_type_name(type_name)))
    except TypeError as error:
        raise TaskRpcError(f"{type_name}: {error}") from None


def message_class(type_name: str) -> Any:
    """Return the class of a message type, also for `pkg/Name`.

    Raises DefinitionError; TaskRpcError for a type that is not a message.
    """
    if type_name.startswith("actionlib_msgs/"):  # ROSLIB.ActionClient
        raise TaskRpcError(f"{type_name}: it is of ROS 1; expected ROSLIB.Action, not ActionClient")
    try:
        return message_type(srvgen.load(message_type_name(type_name)))
    except TypeError as error:
        raise TaskRpcError(f"{type_name}: {error}") from None


def action_class(type_name: str) -> Any:
    """Return the class of an action type, also for `pkg/Name`.

    Raises DefinitionError; TaskRpcError for a type that is not an action.
    """
    try:
        return action_type(srvgen.load(_full_name(type_name, "action")))
    except TypeError as error:
        raise TaskRpcError(f"{type_name}: {error}") from None


def service_type_name(text: str) -> str:
    """Return the full name of a service type; `pkg/Name` means `pkg/srv/Name`."""
    return _full_name(text, "srv")


def message_type_name(text: str) -> str:
    """Return the full name of a message type; `pkg/Name` means `pkg/msg/Name`."""
    return _full_name(text, "msg")


def _full_name(text: str, kind: str) -> str:
    package, *rest = text.split("/")
    return f"{package}/{kind}/{rest[0]}" if len(rest) == 1 else text
