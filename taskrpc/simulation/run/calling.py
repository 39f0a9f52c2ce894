"""Calls that the checks of a scenario make at the end of a run."""

from __future__ import annotations

from typing import Any

import srvgen
import taskrpc
from taskrpc.errors import TaskRpcError

NAME = "check"
"""The name of the program that makes the calls."""
TIMEOUT = 10.0
"""Virtual seconds until a call fails."""


async def call(service: str, fields: dict[str, object]) -> object:
    """Call a service and return its response. Raises TaskRpcError."""
    async with taskrpc.Node(NAME) as node:
        name = node.resolve_service_name(service)
        types = {
            endpoint.type_name
            for entry in await node.graph()
            for endpoint in entry.services
            if endpoint.name == name
        }
        if not types:
            raise TaskRpcError(f"world.call: no program offers {name} at the end of the run")
        srv_type: Any = srvgen.load(types.pop())
        client = node.create_client(srv_type, name)
        return await client.call(srv_type.Request(**fields), timeout=TIMEOUT)
