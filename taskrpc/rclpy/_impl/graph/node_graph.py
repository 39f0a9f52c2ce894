"""What a node sees of the network: its nodes, topics and services."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from taskrpc import names
from taskrpc.errors import InvalidName
from taskrpc.transport.discovery.entries import RegistryEntry

from ...endpoint_info import EndpointTypeEnum, ServiceEndpointInfo, TopicEndpointInfo
from ...exceptions import NodeNameNonExistentError
from ..node_interface import NodeInterface
from .endpoints import ENDPOINTS, service_endpoints, split_node_name, topic_endpoints
from .names import ros_problem

NamesAndTypes = list[tuple[str, list[str]]]

_POLL_INTERVAL = 0.02
"""Seconds between two checks while a program waits for a node."""


class NodeGraph:
    """Reads the graph for one node; `Node` documents the methods."""

    def __init__(self, node: NodeInterface) -> None:
        self._node = node

    def _entries(self) -> list[RegistryEntry]:
        """The visible processes, each with its nodes, topics and services."""
        return self._node.handle.bridge.graph()

    def get_node_names(self) -> list[str]:
        """As `Node.get_node_names`."""
        return [name for name, _ in self._node.get_node_names_and_namespaces()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """As `Node.get_node_names_and_namespaces`."""
        return [split_node_name(node) for entry in self._entries() for node in entry.nodes]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        """As `Node.get_node_names_and_namespaces_with_enclaves`."""
        return [(*pair, "/") for pair in self._node.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """As `Node.get_fully_qualified_node_names`."""
        return [node for entry in self._entries() for node in entry.nodes]

    def get_topic_names_and_types(self, no_demangle: bool = False) -> NamesAndTypes:
        """As `Node.get_topic_names_and_types`."""
        return _mangled(_gathered(self._entries(), _topics), no_demangle)

    def get_service_names_and_types(self) -> NamesAndTypes:
        """As `Node.get_service_names_and_types`."""
        return _gathered(self._entries(), ENDPOINTS[EndpointTypeEnum.SERVER])

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """As `Node.get_publisher_names_and_types_by_node`."""
        found = self._by_node(node_name, node_namespace, EndpointTypeEnum.PUBLISHER)
        return _mangled(found, no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """As `Node.get_subscriber_names_and_types_by_node`."""
        found = self._by_node(node_name, node_namespace, EndpointTypeEnum.SUBSCRIPTION)
        return _mangled(found, no_demangle)

    def get_service_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> NamesAndTypes:
        """As `Node.get_service_names_and_types_by_node`."""
        return self._by_node(node_name, node_namespace, EndpointTypeEnum.SERVER)

    def get_client_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> NamesAndTypes:
        """As `Node.get_client_names_and_types_by_node`."""
        return self._by_node(node_name, node_namespace, EndpointTypeEnum.CLIENT)

    def count_publishers(self, topic_name: str) -> int:
        """As `Node.count_publishers`."""
        return self._count(topic_name, False, EndpointTypeEnum.PUBLISHER)

    def count_subscribers(self, topic_name: str) -> int:
        """As `Node.count_subscribers`."""
        return self._count(topic_name, False, EndpointTypeEnum.SUBSCRIPTION)

    def count_clients(self, service_name: str) -> int:
        """As `Node.count_clients`."""
        return self._count(service_name, True, EndpointTypeEnum.CLIENT)

    def count_services(self, service_name: str) -> int:
        """As `Node.count_services`."""
        return self._count(service_name, True, EndpointTypeEnum.SERVER)

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """As `Node.get_publishers_info_by_topic`."""
        return topic_endpoints(
            self._entries(), EndpointTypeEnum.PUBLISHER, self._topic_of_info(topic_name, no_mangle)
        )

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """As `Node.get_subscriptions_info_by_topic`."""
        return topic_endpoints(
            self._entries(),
            EndpointTypeEnum.SUBSCRIPTION,
            self._topic_of_info(topic_name, no_mangle),
        )

    def get_servers_info_by_service(self, service_name: str) -> list[ServiceEndpointInfo]:
        """As `Node.get_servers_info_by_service`."""
        return service_endpoints(
            self._entries(), EndpointTypeEnum.SERVER, self._absolute_name(service_name, True)
        )

    def get_clients_info_by_service(self, service_name: str) -> list[ServiceEndpointInfo]:
        """As `Node.get_clients_info_by_service`."""
        return service_endpoints(
            self._entries(), EndpointTypeEnum.CLIENT, self._absolute_name(service_name, True)
        )

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """As `Node.wait_for_node`."""
        name = f"/{fully_qualified_node_name.lstrip('/')}"
        end = time.monotonic() + timeout
        while name not in self._node.get_fully_qualified_node_names():
            if time.monotonic() >= end:
                return False
            time.sleep(_POLL_INTERVAL)
        return True

    def _by_node(self, name: str, namespace: str, kind: EndpointTypeEnum) -> NamesAndTypes:
        node = names.fully_qualified(namespace, name)
        entries = [entry for entry in self._entries() if node in entry.nodes]
        if not entries:
            raise NodeNameNonExistentError(
                f"cannot get names and types for nonexistent node: {namespace}, {name}"
            )
        endpoints = ENDPOINTS[kind]
        return _gathered(entries, lambda entry: [e for e in endpoints(entry) if e.node == node])

    def _count(self, name: str, is_service: bool, kind: EndpointTypeEnum) -> int:
        full, endpoints = self._absolute_name(name, is_service), ENDPOINTS[kind]
        return sum(one.name == full for entry in self._entries() for one in endpoints(entry))

    def _topic_of_info(self, name: str, no_mangle: bool) -> str:
        return name.removeprefix("rt") if no_mangle else self._absolute_name(name, False)

    def _absolute_name(self, name: str, is_service: bool) -> str:
        """The absolute name of a topic or service. The texts of the errors are those of ROS."""
        if not isinstance(name, str):
            raise TypeError("bad argument type for built-in operation")
        kind = "service name" if is_service else "topic name"
        try:
            names.check_unexpanded(name, kind)
        except InvalidName as error:
            raise ValueError(f"{kind} '{name}' is invalid: {ros_problem(error)}") from None
        resolve = self._node.resolve_service_name if is_service else self._node.resolve_topic_name
        return resolve(name)


def _topics(entry: RegistryEntry) -> list[Any]:
    return [*entry.publishers, *entry.subscriptions]


def _gathered(
    entries: Iterable[RegistryEntry], endpoints: Callable[[RegistryEntry], Iterable[Any]]
) -> NamesAndTypes:
    """The names of the endpoints, sorted, each with its types."""
    found: dict[str, set[str]] = {}
    for entry in entries:
        for one in endpoints(entry):
            found.setdefault(one.name, set()).add(one.type_name)
    return [(name, sorted(types)) for name, types in sorted(found.items())]


def _mangled(found: NamesAndTypes, no_demangle: bool) -> NamesAndTypes:
    return [(f"rt{name}", types) for name, types in found] if no_demangle else found
