"""Nodes of asyncio for tests."""

import asyncio

import pytest

from taskrpc.ros.packages.rclpy.experimental import AsyncNode
from tests.ros.packages.rclpy.living import PATIENCE


@pytest.fixture
def create(context):
    """Create an AsyncNode without parameter services, and let no test wait for ever."""
    nodes = []
    alarms = []

    def create(name="robot", **settings):
        settings.setdefault("start_parameter_services", False)
        nodes.append(AsyncNode(name, context=context, **settings))
        test = asyncio.current_task()
        alarms.append(asyncio.get_running_loop().call_later(PATIENCE, test.cancel))
        return nodes[-1]

    yield create
    for alarm in alarms:
        alarm.cancel()
    for node in nodes:
        node.destroy_node()
