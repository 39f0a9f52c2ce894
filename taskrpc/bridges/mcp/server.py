"""The MCP server: turns requests of the protocol into calls of tools and reads of resources."""

from __future__ import annotations

import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

import mcp_types as types
from mcp.server import Server, ServerRequestContext
from mcp.shared.exceptions import MCPError
from starlette.requests import Request

from taskrpc.bridges.mcp.arguments import DRY_RUN, REQUEST_ID
from taskrpc.bridges.mcp.calls import ToolCalls
from taskrpc.bridges.mcp.permissions import Permissions
from taskrpc.bridges.mcp.results import EXPLAINED
from taskrpc.bridges.mcp.tools import Tool
from taskrpc.bridges.mcp.topics import PREFIX, Topics
from taskrpc.node import Node

Context: TypeAlias = ServerRequestContext[str, Request]

NAME = "taskrpc"
MAP = "taskrpc://map"
"""The address of the map."""
SESSION_HEADER = "mcp-session-id"

_INSTRUCTIONS = f"""\
The tools call services and actions of robots and other programs. The resources are topics: reading
one returns its newest message.

A tool call that fails returns JSON with `error`, `message`, `executed` (whether it ran: no, yes or
unknown) and `advice`. If `executed` is unknown, follow the advice before you repeat the call. Tools
with {REQUEST_ID} run a repeated request once. {DRY_RUN} only checks a call.
"""


class AgentServer:
    """Serves one agent; all its calls have the rights of `node`, within its permissions.

    `map_file` is the map of the robot, a resource too; None for none.
    """

    def __init__(
        self, node: Node, permissions: Permissions | None = None, map_file: Path | None = None
    ) -> None:
        permissions = permissions or Permissions()
        self._calls = ToolCalls(node, permissions)
        self._topics = Topics(node, permissions)
        self._map_file = map_file
        self.server: Server[str] = Server(
            NAME,
            version=version("taskrpc"),
            title="taskrpc",
            instructions=_INSTRUCTIONS,
            lifespan=_session,
            # No schema wants an argument in a header. Otherwise each call would list all tools.
            get_tool_input_schema=lambda _: None,
            on_list_tools=self._list_tools,
            on_call_tool=self._call_tool,
            on_list_resources=self._list_resources,
            on_read_resource=self._read_resource,
        )
        """The server of the package `mcp`."""

    async def close(self) -> None:
        """Cancel the goals of the agent."""
        await self._calls.close()

    async def _list_tools(
        self, _: Context, __: types.PaginatedRequestParams | None
    ) -> types.ListToolsResult:
        try:
            found = await self._calls.tools.all()
        except EXPLAINED as error:
            raise _protocol_error(error) from None
        return types.ListToolsResult(tools=[_tool(each) for each in found])

    async def _call_tool(
        self, context: Context, params: types.CallToolRequestParams
    ) -> types.CallToolResult:
        result = await self._calls.call(
            params.name,
            params.arguments or {},
            request_id_of(context),
            context.session.report_progress,
        )
        return types.CallToolResult(
            content=[types.TextContent(type="text", text=result.text)],
            structured_content=result.json,
            is_error=result.is_error,
        )

    async def _list_resources(
        self, _: Context, __: types.PaginatedRequestParams | None
    ) -> types.ListResourcesResult:
        try:
            found = await self._topics.all()
        except EXPLAINED as error:
            raise _protocol_error(error) from None
        resources = [
            types.Resource(
                uri=each.uri,
                name=each.topic,
                description=f"The newest message of the topic {each.topic} ({each.type_name})",
                mime_type="application/json",
            )
            for each in found
        ]
        if self._map_file is not None:
            what = "The map of the robot: its size, walls, and the places that tasks can name"
            resources.insert(
                0,
                types.Resource(uri=MAP, name="map", description=what, mime_type="application/yaml"),
            )
        return types.ListResourcesResult(resources=resources)

    async def _read_resource(
        self, _: Context, params: types.ReadResourceRequestParams
    ) -> types.ReadResourceResult:
        uri = str(params.uri)
        if uri == MAP and self._map_file is not None:
            text, kind = self._map_file.read_text(encoding="utf-8-sig"), "application/yaml"
        elif uri.startswith(f"{PREFIX}/"):
            try:
                text, kind = await self._topics.read(uri), "application/json"
            except EXPLAINED as error:
                raise _protocol_error(error) from None
        else:
            problem = f"there is no resource {uri[:200]!r}; expected {PREFIX}/NAME of a topic"
            raise MCPError(types.INVALID_PARAMS, problem)
        contents = types.TextResourceContents(uri=uri, mime_type=kind, text=text)
        return types.ReadResourceResult(contents=[contents])


@asynccontextmanager
async def _session(_: Server[str]) -> AsyncIterator[str]:
    """Name the session of a connection: its requests have ids that other sessions use too."""
    yield secrets.token_hex(8)


def request_id_of(context: Context) -> str:
    """Return an id for the request that no other request has, "" if there is none.

    Over HTTP, clients of the protocol since 2026-07-28 have no session, so that two of them may
    send the same id.
    """
    if context.request_id is None:
        return ""
    session = context.lifespan_context
    if context.request is not None:
        session = context.request.headers.get(SESSION_HEADER, "")
    return f"{session}-{context.request_id}" if session else ""


def _protocol_error(error: Exception) -> MCPError:
    return MCPError(types.INTERNAL_ERROR, f"{type(error).__name__}: {error}")


def _tool(tool: Tool) -> types.Tool:
    return types.Tool(
        name=tool.name,
        title=tool.title,
        description=tool.description,
        input_schema=tool.input_schema,
        output_schema=tool.output_schema,
        annotations=types.ToolAnnotations(
            title=tool.title,
            read_only_hint=tool.is_read_only,
            destructive_hint=not tool.is_read_only,
            idempotent_hint=tool.is_idempotent,
            open_world_hint=False,
        ),
    )
