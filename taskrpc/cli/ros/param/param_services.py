"""Calls the parameter services of a node for commands."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import srvgen
from taskrpc.cli.shared.command import NotFound, hinted
from taskrpc.message_types import RequestT, ResponseT, Srv
from taskrpc.node import Node
from taskrpc.spi import RegistryEntry, names

if TYPE_CHECKING:
    from srvgen.stubs.rcl_interfaces.msg import (
        Parameter,
        ParameterDescriptor,
        ParameterValue,
        SetParametersResult,
    )


class ParamServices:
    """Calls the parameter services of one node (its fully qualified name)."""

    def __init__(self, node: Node, owner: str, timeout: float) -> None:
        self._node = node
        self._owner = owner
        self._timeout = timeout  # seconds for each call

    async def names(self, prefixes: Iterable[str] = ()) -> list[str]:
        """Return the names of all parameters, or of those below the prefixes, sorted."""
        srv_type = srvgen.load("rcl_interfaces/srv/ListParameters")
        request = srv_type.Request(prefixes=list(prefixes))
        response = await self._call(srv_type, "list_parameters", request)
        return sorted(response.result.names)

    async def values(self, names: list[str]) -> list[ParameterValue]:
        """Return the values of parameters, as ParameterValue messages."""
        srv_type = srvgen.load("rcl_interfaces/srv/GetParameters")
        request = srv_type.Request(names=names)
        response = await self._call(srv_type, "get_parameters", request)
        return list(response.values)

    async def descriptors(self, names: list[str]) -> list[ParameterDescriptor]:
        """Return the descriptions of parameters, as ParameterDescriptor messages."""
        srv_type = srvgen.load("rcl_interfaces/srv/DescribeParameters")
        request = srv_type.Request(names=names)
        response = await self._call(srv_type, "describe_parameters", request)
        return list(response.descriptors)

    async def set(self, parameters: list[Parameter]) -> list[SetParametersResult]:
        """Set parameters one by one; returns SetParametersResult messages."""
        srv_type = srvgen.load("rcl_interfaces/srv/SetParameters")
        request = srv_type.Request(parameters=parameters)
        response = await self._call(srv_type, "set_parameters", request)
        return list(response.results)

    async def set_together(self, parameters: list[Parameter]) -> SetParametersResult:
        """Set all parameters or none; returns a SetParametersResult message."""
        srv_type = srvgen.load("rcl_interfaces/srv/SetParametersAtomically")
        request = srv_type.Request(parameters=parameters)
        response = await self._call(srv_type, "set_parameters_atomically", request)
        return response.result

    async def _call(
        self, srv_type: type[Srv[RequestT, ResponseT]], verb: str, request: RequestT
    ) -> ResponseT:
        client = self._node.create_client(srv_type, f"{self._owner}/{verb}", timeout=self._timeout)
        try:
            return await client.call(request)
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
