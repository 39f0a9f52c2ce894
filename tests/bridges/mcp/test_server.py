"""The MCP server: what the official client sees of tools and of the map."""

import json
from types import SimpleNamespace

import pytest

import srvgen
from taskrpc.bridges.mcp.server import SESSION_HEADER, request_id_of
from tests.bridges.mcp.agents import MODES, connected

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    response.sum = request.a + request.b
    return response


@MODES
async def test_service_is_a_tool(mode):
    async with connected(mode=mode) as (node, client):
        node.create_service(ADD, "math/add", add, idempotent=True)
        (tool,) = (await client.list_tools()).tools
        assert (tool.name, tool.title) == ("math-add", "/math/add")
        assert tool.input_schema["properties"]["a"]["maximum"] == 2**63 - 1
        assert tool.annotations.idempotent_hint
        assert not tool.annotations.read_only_hint
        result = await client.call_tool("math-add", {"a": 2, "b": 3})
        assert result.structured_content == {"sum": 5}
        assert json.loads(result.content[0].text) == {"sum": 5}
        assert not result.is_error


async def test_map_is_a_resource(tmp_path):
    file = tmp_path / "map.yaml"
    file.write_text("size: [10, 8]\n")
    async with connected(map_file=file) as (_, client):
        (resource,) = (await client.list_resources()).resources
        (contents,) = (await client.read_resource(str(resource.uri))).contents
        assert contents.text == "size: [10, 8]\n"


@pytest.mark.parametrize(
    ("number", "headers", "expected"),
    [
        (5, None, "own-5"),
        ("a", None, "own-a"),
        (5, {SESSION_HEADER: "theirs"}, "theirs-5"),
        (5, {}, ""),
        (None, None, ""),
    ],
)
def test_request_has_an_id_only_if_no_other_client_can_send_it(number, headers, expected):
    request = None if headers is None else SimpleNamespace(headers=headers)
    context = SimpleNamespace(request_id=number, lifespan_context="own", request=request)
    assert request_id_of(context) == expected
