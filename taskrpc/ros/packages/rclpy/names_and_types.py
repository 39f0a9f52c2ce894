"""The topics and services of the graph, with their types."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .node import Node

NamesAndTypes = list[tuple[str, list[str]]]
"""Names, each with its types."""


def get_publisher_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str, no_demangle: bool = False
) -> NamesAndTypes:
    """The topics that a node publishes; raises NodeNameNonExistentError for an unknown node."""
    return node.get_publisher_names_and_types_by_node(
        remote_node_name, remote_node_namespace, no_demangle
    )


def get_subscriber_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str, no_demangle: bool = False
) -> NamesAndTypes:
    """The topics that a node subscribes to; NodeNameNonExistentError for an unknown node."""
    return node.get_subscriber_names_and_types_by_node(
        remote_node_name, remote_node_namespace, no_demangle
    )


def get_service_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The services that a node offers; raises NodeNameNonExistentError for an unknown node."""
    return node.get_service_names_and_types_by_node(remote_node_name, remote_node_namespace)


def get_client_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The services that a node calls; raises NodeNameNonExistentError for an unknown node."""
    return node.get_client_names_and_types_by_node(remote_node_name, remote_node_namespace)


def get_topic_names_and_types(node: Node, no_demangle: bool = False) -> NamesAndTypes:
    """All topics with their types."""
    return node.get_topic_names_and_types(no_demangle)


def get_service_names_and_types(node: Node) -> NamesAndTypes:
    """All services with their types."""
    return node.get_service_names_and_types()
