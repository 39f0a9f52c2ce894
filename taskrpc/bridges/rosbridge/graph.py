"""What runs on the network at one moment: nodes, services and topics by name."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Iterator

from taskrpc.errors import DeadlineExceeded
from taskrpc.node import Node
from taskrpc.spi import RegistryEntry, ServiceEndpoint, TopicEndpoint, names

TIMEOUT = 5.0
"""Seconds to find out what runs; programs of other machines may be slow."""
_ACTION = "/_action/send_goal"
"""The end of the name of the service with which an action begins."""


class Graph:
    """A snapshot of the network; names that begin with `_` are hidden, as in ROS."""

    def __init__(self, entries: Iterable[RegistryEntry]) -> None:
        self.nodes: list[str] = []
        self.services: list[ServiceEndpoint] = []
        self.publishers: list[TopicEndpoint] = []
        self.subscriptions: list[TopicEndpoint] = []
        for entry in entries:
            self.nodes += _visible(entry.nodes)
            self.services += entry.services
            self.publishers += entry.publishers
            self.subscriptions += entry.subscriptions

    @property
    def topics(self) -> dict[str, str]:
        """Each topic with its type, sorted; the first publisher's type if programs disagree."""
        found: dict[str, str] = {}
        for each in (*self.publishers, *self.subscriptions):
            found.setdefault(each.name, each.type_name)
        return {name: found[name] for name in _visible(sorted(found))}

    @property
    def service_types(self) -> dict[str, str]:
        """Each service with its type, sorted."""
        found = {each.name: each.type_name for each in self.services}
        return {name: found[name] for name in _visible(sorted(found))}

    @property
    def actions(self) -> list[str]:
        """The names of all actions, sorted."""
        ends = {each.name for each in self.services if each.name.endswith(_ACTION)}
        return sorted(name.removesuffix(_ACTION) for name in ends)

    def publishers_of(self, topic: str) -> list[TopicEndpoint]:
        """Return the publishers of a topic."""
        return [each for each in self.publishers if each.name == topic]

    def subscriptions_of(self, topic: str) -> list[TopicEndpoint]:
        """Return the subscriptions of a topic."""
        return [each for each in self.subscriptions if each.name == topic]

    def type_of(self, topic: str) -> str:
        """Return the type of a topic, also of a hidden one; "" if no program has the topic."""
        endpoints = self.publishers_of(topic) or self.subscriptions_of(topic)
        return endpoints[0].type_name if endpoints else ""


async def graph_of(node: Node) -> Graph:
    """Return what a node sees. Raises DeadlineExceeded."""
    try:
        async with asyncio.timeout(TIMEOUT):
            return Graph(await node.graph())
    except TimeoutError:
        problem = f"the programs of the network could not be listed within {TIMEOUT:g} s"
        raise DeadlineExceeded(problem, not_executed=True) from None


def _visible(found: Iterable[str]) -> Iterator[str]:
    return (name for name in found if not names.is_hidden(name))
