"""ROS's graph: which nodes, services and topics there are besides those of taskrpc programs."""

from __future__ import annotations

import contextlib
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from taskrpc.middleware.ros import qualities
from taskrpc.middleware.ros.program_links import id_of_node
from taskrpc.spi import RegistryEntry, ServiceEndpoint, TopicEndpoint

ENCLAVE = "/taskrpc/program_"
"""The beginning of the enclave of taskrpc programs, which ROS's graph shows for each node. Without
ROS's security, an enclave is only a name."""
_HIDDEN = "/_taskrpc/"
"""The beginning of the topics between taskrpc programs."""
_LOOKS_AFTER_CHANGE = 10
"""Looks after a change in which the graph is read again: DDS reports later which node has what."""

ServiceHash = Callable[[str, str, str], str]
"""Returns the hash of a service from its type name and the hashes of its request and response."""


class Graph:
    """What one node sees of ROS's graph."""

    def __init__(self, ros: Any, node: Any, service_hash: ServiceHash) -> None:
        self._ros = ros
        self._node = node
        self._service_hash = service_hash
        self.others = False
        """Whether there is any node besides this one."""
        self._raw: object = None
        """The names at the last look, to see whether something has changed."""
        self._looks_left = 0
        """The number of looks in which the graph is still read again."""
        self._servers: dict[str, list[ServiceEndpoint]] = {}
        """The foreign servers by service."""
        self._entries: list[RegistryEntry] = []

    def look(self) -> list[str] | None:
        """Return the names of all nodes if something has changed a short time ago, else None."""
        node = self._node
        nodes = node.get_node_names_and_namespaces_with_enclaves()
        raw = nodes, node.get_service_names_and_types(), node.get_topic_names_and_types()
        if raw == self._raw:
            self._looks_left -= 1
        else:
            self._raw, self._looks_left = raw, _LOOKS_AFTER_CHANGE
        if self._looks_left <= 0:
            return None
        self.others = len(nodes) > 1
        return [name for name, _, _ in nodes]

    def read(self, own_nodes: Iterable[str]) -> bool:
        """Read the foreign nodes with all they have; return whether anything differs.

        `own_nodes`: the nodes of taskrpc programs as their entries list them.
        """
        own = frozenset(own_nodes)
        foreign = {}
        for name, namespace, enclave in self._node.get_node_names_and_namespaces_with_enclaves():
            full = f"{namespace.rstrip('/')}/{name}"
            if not (enclave.startswith(ENCLAVE) or full in own or id_of_node(name)):
                foreign[full] = name, namespace
        services = {full: self._services(full, *names) for full, names in foreign.items()}
        clients = {full: self._clients(full, *names) for full, names in foreign.items()}
        publishers, subscriptions = self._topics(foreign.keys())
        entries = [
            RegistryEntry(
                pid=0,
                script=f"ROS 2 node {full}",
                folder="",
                since=0.0,
                nodes=(full,),
                services=tuple(services[full]),
                clients=tuple(clients[full]),
                publishers=tuple(publishers[full]),
                subscriptions=tuple(subscriptions[full]),
            )
            for full in sorted(foreign)
        ]
        if entries == self._entries:
            return False
        self._entries = entries
        self._servers = defaultdict(list)
        for each in (each for entry in entries for each in entry.services):
            self._servers[each.name].append(each)
        return True

    def entries(self) -> list[RegistryEntry]:
        """The foreign nodes, one entry for each."""
        return list(self._entries)

    def servers(self, service: str) -> list[ServiceEndpoint]:
        """The foreign servers of a service."""
        return self._servers.get(service, [])

    def _services(self, full: str, name: str, namespace: str) -> list[ServiceEndpoint]:
        found = self._of_node(self._node.get_service_names_and_types_by_node, name, namespace)
        return [
            ServiceEndpoint(service, types[0], self._hash(service, types[0], full), full)
            for service, types in found
        ]

    def _clients(self, full: str, name: str, namespace: str) -> list[ServiceEndpoint]:
        found = self._of_node(self._node.get_client_names_and_types_by_node, name, namespace)
        return [ServiceEndpoint(service, types[0], "", full) for service, types in found]

    def _of_node(self, read: Any, name: str, namespace: str) -> list[tuple[str, list[str]]]:
        with contextlib.suppress(Exception):  # the node has just left: rclpy raises several kinds
            return [each for each in read(name, namespace) if each[1]]
        return []

    def _hash(self, service: str, type_name: str, server: str) -> str:
        """Return the type hash of a server's service, "" if ROS does not tell it."""
        node = self._node
        if hasattr(node, "get_servers_info_by_service"):  # from ROS 2 Lyrical on
            for info in node.get_servers_info_by_service(service):
                if _node_of(info) == server:
                    return qualities.hash_text(info.service_type_hash)
            return ""
        # DDS carries a service on two topics, which have hashes of their own.
        replies = node.get_publishers_info_by_topic(f"rr{service}Reply", no_mangle=True)
        requests = node.get_subscriptions_info_by_topic(f"rq{service}Request", no_mangle=True)
        response, request = _hash_at(replies, server), _hash_at(requests, server)
        return self._service_hash(type_name, request, response) if request and response else ""

    def _topics(
        self, foreign: Iterable[str]
    ) -> tuple[dict[str, list[TopicEndpoint]], dict[str, list[TopicEndpoint]]]:
        publishers: dict[str, list[TopicEndpoint]] = {each: [] for each in foreign}
        subscriptions: dict[str, list[TopicEndpoint]] = {each: [] for each in publishers}
        node = self._node
        for topic, _ in node.get_topic_names_and_types():
            if topic.startswith(_HIDDEN):
                continue
            for read, found in (
                (node.get_publishers_info_by_topic, publishers),
                (node.get_subscriptions_info_by_topic, subscriptions),
            ):
                for info in read(topic):
                    name = _node_of(info)
                    if name in found:
                        seen = qualities.topic_endpoint(self._ros, topic, name, info)
                        found[name].append(seen)
        return publishers, subscriptions


def _node_of(info: Any) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _hash_at(infos: list[Any], server: str) -> str:
    found = [info for info in infos if _node_of(info) == server]
    return qualities.hash_text(found[0].topic_type_hash) if found else ""
