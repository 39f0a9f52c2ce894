"""Finds definitions for commands, first in the workspace around the working directory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import srvgen
from srvgen.classes.loader import search_first
from srvgen.files.search import Search


def search() -> Search:
    """Return a search that begins with the packages of this workspace."""
    return Search(_roots())


def load(type_name: str) -> Any:
    """Return the class of a type. Raises DefinitionError."""
    search_first(_roots())
    return srvgen.load(type_name)


def _roots() -> list[Path]:
    from taskrpc.ros import workspace

    return workspace.roots(Path.cwd())


def service_type_name(text: str) -> str:
    """Return the full name of a service's type; `pkg/Name` means `pkg/srv/Name`."""
    package, *rest = text.split("/")
    return f"{package}/srv/{rest[0]}" if len(rest) == 1 else text


def local_service_type(text: str) -> Any:
    """Return the class of a service type that is defined on this machine.

    Raises DefinitionError, with ros2's text, if there is none.
    """
    try:
        found = load(service_type_name(text))
    except srvgen.DefinitionError as error:
        raise srvgen.DefinitionError(
            "The passed service type is invalid", hint=str(error)
        ) from None
    if not hasattr(found, "Request"):
        raise srvgen.DefinitionError(
            "The passed type is not a service", hint=f"{text} has no request and no response"
        )
    return found


def differs_here(cls: Any) -> bool:
    """Whether this machine's definition of a type differs from the server's."""
    try:
        return bool(load(cls._TYPE)._HASH != cls._HASH)
    except srvgen.DefinitionError:
        return False
