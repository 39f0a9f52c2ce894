"""The part of a node that looks at the network: which nodes, topics and services there are."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from taskrpc import names
from taskrpc.errors import InvalidName
from taskrpc.transport.discovery.entries import Entry

from ...endpoint_info import ServiceEndpointInfo, TopicEndpointInfo
from ...exceptions import NodeNameNonExistentError
from ..node_interface import NodeHandle
from .endpoints import clients_of, publishers_of, servers_of, split, subscriptions_of
from .names import ros_problem

NamesAndTypes = list[tuple[str, list[str]]]

_LOOK_AGAIN = 0.02
"""Seconds between two checks while a program waits for a node."""


class NodeGraph:
    """Questions about all nodes that can be seen, this one included."""

    _rclpy_handle: NodeHandle
    _rclpy_resolve: Callable[..., str]

    def get_node_names(self) -> list[str]:
        """The names of all nodes."""
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        """The name and namespace of every node."""
        return [split(node) for entry in self._rclpy_handle.bridge.graph() for node in entry.nodes]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        """The name, namespace and enclave (always `/`) of every node."""
        return [(*pair, "/") for pair in self.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """`/namespace/name` of every node."""
        return [node for entry in self._rclpy_handle.bridge.graph() for node in entry.nodes]

    def get_topic_names_and_types(self, no_demangle: bool = False) -> NamesAndTypes:
        """All topics with their types; `no_demangle` shows names as DDS has them (`rt/…`)."""
        return _mangled(_gathered(self._rclpy_handle.bridge.graph(), _topics), no_demangle)

    def get_service_names_and_types(self) -> NamesAndTypes:
        """All services with their types."""
        return _gathered(self._rclpy_handle.bridge.graph(), lambda entry: entry.services)

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """The topics that a node publishes; raises NodeNameNonExistentError for an unknown one."""
        found = self._rclpy_by_node(node_name, node_namespace, lambda entry: entry.publishers)
        return _mangled(found, no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """The topics that a node reads; raises NodeNameNonExistentError for an unknown one."""
        found = self._rclpy_by_node(node_name, node_namespace, lambda entry: entry.subscriptions)
        return _mangled(found, no_demangle)

    def get_service_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> NamesAndTypes:
        """The services that a node offers; raises NodeNameNonExistentError for an unknown one."""
        return self._rclpy_by_node(node_name, node_namespace, lambda entry: entry.services)

    def get_client_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> NamesAndTypes:
        """The services that a node calls; raises NodeNameNonExistentError for an unknown one."""
        return self._rclpy_by_node(node_name, node_namespace, lambda entry: entry.clients)

    def count_publishers(self, topic_name: str) -> int:
        """How many publishers a topic has."""
        return self._rclpy_count(topic_name, False, lambda entry: entry.publishers)

    def count_subscribers(self, topic_name: str) -> int:
        """How many subscriptions a topic has."""
        return self._rclpy_count(topic_name, False, lambda entry: entry.subscriptions)

    def count_clients(self, service_name: str) -> int:
        """How many clients a service has."""
        return self._rclpy_count(service_name, True, lambda entry: entry.clients)

    def count_services(self, service_name: str) -> int:
        """How many servers a service has."""
        return self._rclpy_count(service_name, True, lambda entry: entry.services)

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Every publisher of a topic; `no_mangle` takes names as DDS has them (`rt/…`)."""
        return publishers_of(
            self._rclpy_handle.bridge.graph(), self._rclpy_topic_of_info(topic_name, no_mangle)
        )

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        """Every subscription of a topic; `no_mangle` takes names as DDS has them (`rt/…`)."""
        return subscriptions_of(
            self._rclpy_handle.bridge.graph(), self._rclpy_topic_of_info(topic_name, no_mangle)
        )

    def get_servers_info_by_service(self, service_name: str) -> list[ServiceEndpointInfo]:
        """Every server of a service."""
        return servers_of(
            self._rclpy_handle.bridge.graph(), self._rclpy_looked_for(service_name, True)
        )

    def get_clients_info_by_service(self, service_name: str) -> list[ServiceEndpointInfo]:
        """Every client of a service."""
        return clients_of(
            self._rclpy_handle.bridge.graph(), self._rclpy_looked_for(service_name, True)
        )

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait until a node is there, at most `timeout` seconds; whether it is."""
        name = f"/{fully_qualified_node_name.lstrip('/')}"
        end = time.monotonic() + timeout
        while name not in self.get_fully_qualified_node_names():
            if time.monotonic() >= end:
                return False
            time.sleep(_LOOK_AGAIN)
        return True

    def _rclpy_by_node(
        self, name: str, namespace: str, things: Callable[[Entry], Iterable[Any]]
    ) -> NamesAndTypes:
        node = names.fully_qualified(namespace, name)
        entries = [entry for entry in self._rclpy_handle.bridge.graph() if node in entry.nodes]
        if not entries:
            raise NodeNameNonExistentError(
                f"cannot get names and types for nonexistent node: {namespace}, {name}"
            )
        return _gathered(entries, lambda entry: [one for one in things(entry) if one.node == node])

    def _rclpy_count(
        self, name: str, is_service: bool, things: Callable[[Entry], Iterable[Any]]
    ) -> int:
        full = self._rclpy_looked_for(name, is_service)
        return sum(
            one.name == full for entry in self._rclpy_handle.bridge.graph() for one in things(entry)
        )

    def _rclpy_topic_of_info(self, name: str, no_mangle: bool) -> str:
        return name.removeprefix("rt") if no_mangle else self._rclpy_looked_for(name, False)

    def _rclpy_looked_for(self, name: str, is_service: bool) -> str:
        """The absolute name of what is asked for; the texts are ROS's."""
        if not isinstance(name, str):
            raise TypeError("bad argument type for built-in operation")
        kind = "service name" if is_service else "topic name"
        try:
            names.check_unexpanded(name, kind)
        except InvalidName as error:
            raise ValueError(f"{kind} '{name}' is invalid: {ros_problem(error)}") from None
        return self._rclpy_resolve(name, is_service=is_service)


def _topics(entry: Entry) -> list[Any]:
    return [*entry.publishers, *entry.subscriptions]


def _gathered(entries: Iterable[Entry], things: Callable[[Entry], Iterable[Any]]) -> NamesAndTypes:
    found: dict[str, set[str]] = {}
    for entry in entries:
        for one in things(entry):
            found.setdefault(one.name, set()).add(one.type_name)
    return [(name, sorted(types)) for name, types in sorted(found.items())]


def _mangled(found: NamesAndTypes, no_demangle: bool) -> NamesAndTypes:
    return [(f"rt{name}", types) for name, types in found] if no_demangle else found
