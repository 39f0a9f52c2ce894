"""Contexts, executors and nodes for tests of the rclpy layer."""

from __future__ import annotations

import pytest

from taskrpc.rclpy.context import Context
from taskrpc.rclpy.executors import SingleThreadedExecutor
from tests.rclpy.fakes import FakeNode
from tests.rclpy.living import living


@pytest.fixture
def context():
    context = Context()
    context.init([])
    yield context
    context.try_shutdown()


@pytest.fixture
def fake(context):
    return FakeNode(context)


@pytest.fixture
def executor(context, fake):
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(fake)
    yield executor
    executor.shutdown()


@pytest.fixture
def world():
    """Nodes that live on the network."""
    with living() as world:
        yield world
