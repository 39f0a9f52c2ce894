"""An agent without a process: the official client, connected to a bridge in memory."""

import contextlib
import json

import pytest
from mcp import Client

import taskrpc
from taskrpc.bridges.mcp.permissions import Permissions
from taskrpc.bridges.mcp.server import AgentServer

MODES = pytest.mark.parametrize("mode", ["auto", "legacy"])
"""The protocol since 2026-07-28, and the one before it."""


@contextlib.asynccontextmanager
async def connected(door=None, name="", *, mode="auto", map_file=None):
    """A node of a program, and the client of an agent."""
    bridge_node = taskrpc.Node("mcp_bridge", transport="memory")
    async with taskrpc.Node("program", transport="memory") as node, bridge_node:
        agent = AgentServer(bridge_node, Permissions(door, name), map_file)
        try:
            async with Client(agent.server, mode=mode) as client:
                yield node, client
        finally:
            await agent.close()


def failed(result):
    """The error in the result of a tool."""
    assert result.is_error
    assert json.loads(json.dumps(result.structured_content)) == result.structured_content
    return result.structured_content
