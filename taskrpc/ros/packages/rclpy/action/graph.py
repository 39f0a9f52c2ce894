"""The actions that nodes offer and use."""

from __future__ import annotations

from .._impl.graph.node_graph import GraphMethods, NamesAndTypes, actions_of


def get_action_client_names_and_types_by_node(
    node: GraphMethods, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node has clients of, with their types.

    Raises NodeNameNonExistentError for an unknown node.
    """
    read = node.get_subscriber_names_and_types_by_node
    return actions_of(read(remote_node_name, remote_node_namespace))


def get_action_server_names_and_types_by_node(
    node: GraphMethods, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node offers, with their types.

    Raises NodeNameNonExistentError for an unknown node.
    """
    read = node.get_publisher_names_and_types_by_node
    return actions_of(read(remote_node_name, remote_node_namespace))


def get_action_names_and_types(node: GraphMethods) -> NamesAndTypes:
    """All actions, of servers and of clients, with their types."""
    return node.get_action_names_and_types()
