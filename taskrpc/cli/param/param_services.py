"""Calls the parameter services of a node for commands."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import srvgen
from taskrpc.cli.shared.command import NotFound, hinted
from taskrpc.node import Node
from taskrpc.spi import RegistryEntry, names


class ParamServices:
    """Calls the parameter services of one node (its fully qualified name)."""

    def __init__(self, node: Node, owner: str, timeout: float) -> None:
        self._node = node
        self._owner = owner
        self._timeout = timeout  # seconds for each call

    async def names(self, prefixes: Iterable[str] = ()) -> list[str]:
        """Return the names of all parameters, or of those below the prefixes, sorted."""
        response = await self._call("ListParameters", "list_parameters", prefixes=list(prefixes))
        return sorted(response.result.names)

    async def values(self, names: list[str]) -> list[Any]:
        """Return the values of parameters, as ParameterValue messages."""
        response = await self._call("GetParameters", "get_parameters", names=names)
        return list(response.values)

    async def descriptors(self, names: list[str]) -> list[Any]:
        """Return the descriptions of parameters, as ParameterDescriptor messages."""
        response = await self._call("DescribeParameters", "describe_parameters", names=names)
        return list(response.descriptors)

    async def set(self, parameters: list[Any]) -> list[Any]:
        """Set parameters one by one; returns SetParametersResult messages."""
        response = await self._call("SetParameters", "set_parameters", parameters=parameters)
        return list(response.results)

    async def set_together(self, parameters: list[Any]) -> Any:
        """Set all parameters or none; returns a SetParametersResult message."""
        response = await self._call(
            "SetParametersAtomically", "set_parameters_atomically", parameters=parameters
        )
        return response.result

    async def _call(self, type_name: str, verb: str, **fields: Any) -> Any:
        srv_type = srvgen.load(f"rcl_interfaces/srv/{type_name}")
        client = self._node.create_client(srv_type, f"{self._owner}/{verb}", timeout=self._timeout)
        try:
            return await client.call(srv_type.Request(**fields))
        finally:
            client.destroy()


def owners(entries: Iterable[RegistryEntry]) -> list[str]:
    """Return the nodes that have parameters, sorted."""
    end = "/list_parameters"
    names = (service.name for entry in entries for service in entry.services)
    return sorted(name.removesuffix(end) for name in names if name.endswith(end))


def checked_owner(name: str, entries: Iterable[RegistryEntry], *, hidden: bool) -> str:
    """Return the name of a running node; a hidden one only with `hidden`. Raises NotFound."""
    from srvgen.definitions.names import did_you_mean

    running = {node for entry in entries for node in entry.nodes}
    known = {node for node in running if hidden or not names.is_hidden_node(node)}
    if name in known:
        return name
    hint = did_you_mean(name, known)
    if name in running:
        hint = f"{name} is hidden; add --include-hidden-nodes"
    raise hinted(NotFound("Node not found"), hint)
