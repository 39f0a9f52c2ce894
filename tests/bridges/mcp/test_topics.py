"""Topics as resources, read by the official client."""

import json

import pytest
from mcp.shared.exceptions import MCPError

import srvgen
import taskrpc
from taskrpc.bridges.door import Decision, Outcome
from tests.bridges.mcp.agents import MODES, connected
from tests.bridges.mcp.doors import TableDoor

STRING = srvgen.load("std_msgs/msg/String")


@MODES
async def test_topic_is_a_resource(mode):
    async with connected(mode=mode) as (node, client):
        publisher = node.create_publisher(
            STRING, "robot/state", taskrpc.QoS(1, durability="transient_local")
        )
        publisher.publish(STRING(data="ready"))
        (resource,) = (await client.list_resources()).resources
        assert str(resource.uri) == "taskrpc://topics/robot/state"
        (contents,) = (await client.read_resource(str(resource.uri))).contents
        assert json.loads(contents.text) == {"data": "ready"}


@pytest.mark.parametrize(
    ("uri", "text"),
    [
        ("taskrpc://topics/nothing", "ServiceUnavailable: no program publishes /nothing"),
        ("taskrpc://topics/silent", "DeadlineExceeded: /silent: no message within 5 s"),
        ("taskrpc://map", "there is no resource 'taskrpc://map'"),
        ("file:///etc/passwd", "there is no resource 'file:///etc/passwd'"),
    ],
)
async def test_resource_that_cannot_be_read_says_why(uri, text):
    async with connected() as (node, client):
        node.create_publisher(STRING, "silent")
        with pytest.raises(MCPError) as refused:
            await client.read_resource(uri)
        assert text in str(refused.value)


async def test_policy_decides_which_topics_are_read():
    door = TableDoor(shown=Decision(Outcome.ALLOWED))
    async with connected(door, "agents") as (node, client):
        for name in ("shown", "secret"):
            qos = taskrpc.QoS(1, durability="transient_local")
            node.create_publisher(STRING, name, qos).publish(STRING(data=name))
        assert [each.name for each in (await client.list_resources()).resources] == ["/shown"]
        with pytest.raises(MCPError, match="no rule lets agents read /secret"):
            await client.read_resource("taskrpc://topics/secret")
