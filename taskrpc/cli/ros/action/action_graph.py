"""The actions of the running programs, and their types."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import srvgen
from taskrpc.cli.shared import definitions
from taskrpc.spi import RegistryEntry, TopicEndpoint, action_of_feedback


class Action:
    """One action: the nodes of its clients and servers, each with the type that it uses."""

    def __init__(self) -> None:
        self.clients: dict[str, str] = {}
        self.servers: dict[str, str] = {}

    @property
    def types(self) -> list[str]:
        """The names of its types; several if programs disagree."""
        return sorted({*self.clients.values(), *self.servers.values()})


def actions(entries: Iterable[RegistryEntry]) -> dict[str, Action]:
    """Return all actions by name, in the order of their names."""
    found: dict[str, Action] = {}
    for entry in entries:
        for name, type_name, endpoint in _feedback(entry.publishers):
            found.setdefault(name, Action()).servers[endpoint.node] = type_name
        for name, type_name, endpoint in _feedback(entry.subscriptions):
            found.setdefault(name, Action()).clients[endpoint.node] = type_name
    return {name: found[name] for name in sorted(found)}


def _feedback(endpoints: Iterable[TopicEndpoint]) -> Iterable[tuple[str, str, TopicEndpoint]]:
    """Return the endpoints that carry feedback: the name and the type of the action, and each."""
    for each in endpoints:
        if (action := action_of_feedback(each.name, each.type_name)) is not None:
            yield *action, each


def action_type_name(text: str) -> str:
    """Return the full name of an action's type; `pkg/Name` means `pkg/action/Name`."""
    package, *rest = text.split("/")
    return f"{package}/action/{rest[0]}" if len(rest) == 1 else text


def action_type(text: str) -> Any:
    """Return the class of an action type that is defined on this machine.

    Raises DefinitionError, with ros2's text, if there is none.
    """
    try:
        found = definitions.load(action_type_name(text))
    except srvgen.DefinitionError as error:
        problem = "The passed action type is invalid"
        raise srvgen.DefinitionError(problem, hint=str(error)) from None
    if not hasattr(found, "Goal"):
        problem = "The passed action type is invalid"
        raise srvgen.DefinitionError(problem, hint=f"{text} is not an action")
    return found
