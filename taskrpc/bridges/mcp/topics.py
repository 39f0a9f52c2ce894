"""Topics as resources: a read returns the last message that is kept, or the next one."""

from __future__ import annotations

import asyncio
from typing import Any

import msgspec

from taskrpc.bridges.mcp.permissions import Permissions
from taskrpc.bridges.mcp.results import json_of
from taskrpc.bridges.mcp.tool_names import is_valid
from taskrpc.bridges.rosbridge.graph import graph_of
from taskrpc.bridges.rosbridge.types import message_class
from taskrpc.errors import DeadlineExceeded, ServiceUnavailable
from taskrpc.node import Node
from taskrpc.qos import qos_for_all

PREFIX = "taskrpc://topics"
"""The start of the address of a topic; its absolute name follows."""
TIMEOUT = 5.0
"""Seconds to wait for a message."""
MAX_READS = 16
"""Topics that are read at a time; further reads wait."""


class TopicResource(msgspec.Struct, frozen=True):
    """A topic that an agent may read."""

    uri: str
    topic: str
    type_name: str


class Topics:
    """The topics of the network that an agent may read."""

    def __init__(self, node: Node, permissions: Permissions) -> None:
        self._node = node
        self._permissions = permissions
        self._turn = asyncio.Semaphore(MAX_READS)

    async def all(self) -> list[TopicResource]:
        """Return the topics, sorted by name. Raises DeadlineExceeded."""
        topics = (await graph_of(self._node)).topics
        return [
            TopicResource(f"{PREFIX}{topic}", topic, type_name)
            for topic, type_name in topics.items()
            if is_valid(topic, type_name) and self._permissions.shows("read", topic)
        ]

    async def read(self, uri: str) -> str:
        """Return one message of a topic as JSON text.

        Raises Refused, ServiceUnavailable for a topic without a publisher, DeadlineExceeded if no
        message arrives, InvalidName, DefinitionError.
        """
        topic = self._node.resolve_topic_name(uri.removeprefix(PREFIX))
        self._permissions.check("read", topic)
        async with self._turn:
            publishers = (await graph_of(self._node)).publishers_of(topic)
            if not publishers:
                raise ServiceUnavailable(f"no program publishes {topic}")
            arrived: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

            def receive(message: Any) -> None:
                if not arrived.done():
                    arrived.set_result(message)

            cls, qos = message_class(publishers[0].type_name), qos_for_all(publishers, 1)
            subscription = self._node.create_subscription(cls, topic, receive, qos)
            try:
                async with asyncio.timeout(TIMEOUT):
                    message = await arrived
            except TimeoutError:
                problem = f"{topic}: no message within {TIMEOUT:g} s; read it again later"
                raise DeadlineExceeded(problem) from None
            finally:
                subscription.destroy()
        return msgspec.json.encode(json_of(message)).decode()
