"""The type of a service as a command line names it, and as its server defines it."""

from __future__ import annotations

from typing import Any

import srvgen
from taskrpc.cli.shared import definitions


def service_type_name(text: str) -> str:
    """The full name of a service's type; `pkg/Name` means `pkg/srv/Name`."""
    package, *rest = text.split("/")
    return f"{package}/srv/{rest[0]}" if len(rest) == 1 else text


def local_service_type(text: str) -> Any:
    """The class of a service type that this machine has a definition of.

    Raises DefinitionError, in ros2's words, when there is none.
    """
    try:
        found = definitions.load(service_type_name(text))
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
    """Whether this machine has another definition of a type than its server."""
    try:
        return bool(definitions.load(cls._TYPE)._HASH != cls._HASH)
    except srvgen.DefinitionError:
        return False
