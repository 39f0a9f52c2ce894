"""The names of tools, made from the names of services and actions. Pure.

A name stays the same as long as the service has its name, and two services never share one: no name
of ROS has a `-`, and no part of one begins with a digit.
"""

from __future__ import annotations

import hashlib

from srvgen import DefinitionError
from srvgen.definitions.names import split_type_name
from taskrpc.errors import InvalidName
from taskrpc.spi import names

LONGEST = 48
"""Characters of a name. Some models allow 64, and clients put the name of the server in front."""
_DIGEST = 14
"""Hexadecimal digits that tell shortened names apart."""
_ACTION = "--goal"
"""The end of an action's tool: a service may have the same name as an action."""


def tool_name(service: str) -> str:
    """Return the name of the tool that calls a service: `robot_task-list` for `/robot_task/list`.

    `service` is an absolute name.
    """
    return _shortened(_joined(service))


def action_tool_name(action: str) -> str:
    """Return the name of the tool that sends a goal: `arm-lift--goal` for the action `/arm/lift`.

    `action` is an absolute name.
    """
    return _shortened(f"{_joined(action)}{_ACTION}")


def is_valid(name: str, type_name: str) -> bool:
    """Return whether a name and a type follow the rules of ROS.

    A program of another machine may send any text, also one that is meant for the agent.
    """
    try:
        names.check_absolute(name)
        split_type_name(type_name)
    except (InvalidName, DefinitionError):
        return False
    return True


def _joined(name: str) -> str:
    return name.removeprefix("/").replace("/", "-")


def _shortened(name: str) -> str:
    """Return a name of at most `LONGEST` characters; `-0` occurs only in shortened names."""
    if len(name) <= LONGEST:
        return name
    digest = hashlib.sha256(name.encode()).hexdigest()[:_DIGEST]
    return f"{name[: LONGEST - _DIGEST - 2]}-0{digest}"
