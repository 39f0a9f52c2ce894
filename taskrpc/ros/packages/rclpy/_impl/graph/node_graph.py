"""What a node sees of the network: its nodes, topics and services."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from taskrpc.errors import InvalidName
from taskrpc.spi import RegistryEntry, action_of_feedback, names

from ...endpoint_info import EndpointTypeEnum, ServiceEndpointInfo, TopicEndpointInfo
from ...exceptions import NodeNameNonExistentError
from ..node_interface import NodeHandle
from .endpoints import ENDPOINTS, service_endpoints, split_node_name, topic_endpoints
from .names import ros_problem

NamesAndTypes = list[tuple[str, list[str]]]

_POLL_INTERVAL = 0.02
"""Seconds between two checks while a program waits for a node."""

_NODES = "Failed to get node names"
_INFO = "Failed to get information by topic for"
_KINDS = {
    EndpointTypeEnum.PUBLISHER: "publishers",
    EndpointTypeEnum.SUBSCRIPTION: "subscribers",
    EndpointTypeEnum.SERVER: "services",
    EndpointTypeEnum.CLIENT: "clients",
}
"""The words of ROS in the errors of these methods."""


class GraphMethods:
    """The part of `Node` that reads the graph."""

    _rclpy_handle: NodeHandle

    def get_node_names(self) -> list[str]:
        """The names of all nodes."""
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """The name and namespace of every node."""
        return [
            split_node_name(node)
            for entry in _entries(self._rclpy_handle, _NODES)
            for node in entry.nodes
        ]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        """The name, namespace and enclave (always `/`) of every node."""
        return [(*pair, "/") for pair in self.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """`/namespace/name` of every node."""
        return [node for entry in _entries(self._rclpy_handle, _NODES) for node in entry.nodes]

    def get_topic_names_and_types(self, no_demangle: bool = False) -> NamesAndTypes:
        """All topics with their types; `no_demangle` shows names as DDS has them (`rt/…`)."""
        entries = _entries(self._rclpy_handle, "failed to get topic names and types")
        return _mangled(_gathered(entries, _topics), no_demangle)

    def get_service_names_and_types(self) -> NamesAndTypes:
        """All services with their types."""
        entries = _entries(self._rclpy_handle, "failed to get service names and types")
        return _gathered(entries, ENDPOINTS[EndpointTypeEnum.SERVER])

    def get_action_names_and_types(self) -> NamesAndTypes:
        """All actions, of servers and of clients, with their types."""
        return actions_of(self.get_topic_names_and_types())

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """The topics that a node publishes; raises NodeNameNonExistentError for an unknown node."""
        found = _by_node(self._rclpy_handle, node_name, node_namespace, EndpointTypeEnum.PUBLISHER)
        return _mangled(found, no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """The topics that a node subscribes to; NodeNameNonExistentError for an unknown node."""
        found = _by_node(
            self._rclpy_handle, node_name, node_namespace, EndpointTypeEnum.SUBSCRIPTION
        )
        return _mangled(found, no_demangle)

    def get_service_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> NamesAndTypes:
        """The services that a node offers; raises NodeNameNonExistentError for an unknown node."""
        return _by_node(self._rclpy_handle, node_name, node_namespace, EndpointTypeEnum.SERVER)

    def get_client_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> NamesAndTypes:
        """The services that a node calls; raises NodeNameNonExistentError for an unknown node."""
        return _by_node(self._rclpy_handle, node_name, node_namespace, EndpointTypeEnum.CLIENT)

    def count_publishers(self, topic_name: str) -> int:
        """How many publishers a topic has."""
        return _count(self._rclpy_handle, topic_name, False, EndpointTypeEnum.PUBLISHER)

    def count_subscribers(self, topic_name: str) -> int:
        """How many subscriptions a topic has."""
        return _count(self._rclpy_handle, topic_name, False, EndpointTypeEnum.SUBSCRIPTION)

    def count_clients(self, service_name: str) -> int:
        """How many clients a service has."""
        return _count(self._rclpy_handle, service_name, True, EndpointTypeEnum.CLIENT)

    def count_services(self, service_name: str) -> int:
        """How many servers a service has."""
        return _count(self._rclpy_handle, service_name, True, EndpointTypeEnum.SERVER)

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Every publisher of a topic; `no_mangle` takes names as DDS has them (`rt/…`)."""
        return topic_endpoints(
            _entries(self._rclpy_handle, f"{_INFO} publishers"),
            EndpointTypeEnum.PUBLISHER,
            _topic_of_info(self._rclpy_handle, topic_name, no_mangle),
        )

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Every subscription of a topic; `no_mangle` takes names as DDS has them (`rt/…`)."""
        return topic_endpoints(
            _entries(self._rclpy_handle, f"{_INFO} subscriptions"),
            EndpointTypeEnum.SUBSCRIPTION,
            _topic_of_info(self._rclpy_handle, topic_name, no_mangle),
        )

    def get_servers_info_by_service(self, service_name: str) -> list[ServiceEndpointInfo]:
        """Every server of a service."""
        return service_endpoints(
            _entries(self._rclpy_handle, f"{_INFO} servers"),
            EndpointTypeEnum.SERVER,
            _absolute_name(self._rclpy_handle, service_name, True),
        )

    def get_clients_info_by_service(self, service_name: str) -> list[ServiceEndpointInfo]:
        """Every client of a service."""
        return service_endpoints(
            _entries(self._rclpy_handle, f"{_INFO} clients"),
            EndpointTypeEnum.CLIENT,
            _absolute_name(self._rclpy_handle, service_name, True),
        )

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait for a node, at most `timeout` seconds; returns whether it is there."""
        name = f"/{fully_qualified_node_name.lstrip('/')}"
        end = time.monotonic() + timeout
        while name not in self.get_fully_qualified_node_names():
            if time.monotonic() >= end:
                return False
            time.sleep(_POLL_INTERVAL)
        return True


def actions_of(topics: Iterable[tuple[str, list[str]]]) -> NamesAndTypes:
    """The actions to which feedback topics belong, with their types."""
    found: dict[str, list[str]] = {}
    for topic, type_names in topics:
        for type_name in type_names:
            if (action := action_of_feedback(topic, type_name)) is not None:
                found.setdefault(action[0], []).append(action[1])
    return list(found.items())


def _entries(handle: NodeHandle, failed: str) -> list[RegistryEntry]:
    """The visible processes, each with its nodes, topics and services.

    Raises InvalidHandle for a destroyed node, RCLError after the shutdown; `failed` begins its
    message.
    """
    handle.check()
    handle.owner.context.check(failed)
    return handle.bridge.graph()


def _by_node(
    handle: NodeHandle, name: str, namespace: str, kind: EndpointTypeEnum
) -> NamesAndTypes:
    node = names.fully_qualified(namespace, name)
    failed = f"failed to get {_KINDS[kind][:-1]} names and types"
    entries = [entry for entry in _entries(handle, failed) if node in entry.nodes]
    if not entries:
        raise NodeNameNonExistentError(
            f"cannot get names and types for nonexistent node: {namespace}, {name}"
        )
    endpoints = ENDPOINTS[kind]
    return _gathered(entries, lambda entry: [e for e in endpoints(entry) if e.node == node])


def _count(handle: NodeHandle, name: str, is_service: bool, kind: EndpointTypeEnum) -> int:
    full, endpoints = _absolute_name(handle, name, is_service), ENDPOINTS[kind]
    entries = _entries(handle, f"Error in rcl_count_{_KINDS[kind]}")
    return sum(one.name == full for entry in entries for one in endpoints(entry))


def _topic_of_info(handle: NodeHandle, name: str, no_mangle: bool) -> str:
    return name.removeprefix("rt") if no_mangle else _absolute_name(handle, name, False)


def _absolute_name(handle: NodeHandle, name: str, is_service: bool) -> str:
    """The absolute name of a topic or service. The texts of the errors are those of ROS."""
    if not isinstance(name, str):
        raise TypeError("bad argument type for built-in operation")
    kind = "service name" if is_service else "topic name"
    try:
        names.check_unexpanded(name, kind)
    except InvalidName as error:
        raise ValueError(f"{kind} '{name}' is invalid: {ros_problem(error)}") from None
    return handle.resolve(name, is_service=is_service, only_expand=False)


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
