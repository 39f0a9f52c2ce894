"""The actions that nodes offer and use."""

from __future__ import annotations

from collections.abc import Iterable

from taskrpc.actions.names import action_of_feedback

from .._impl.graph.node_graph import GraphMethods, NamesAndTypes


def get_action_client_names_and_types_by_node(
    node: GraphMethods, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node has clients of, with their types.

    Raises NodeNameNonExistentError for an unknown node.
    """
    read = node.get_subscriber_names_and_types_by_node
    return _actions(read(remote_node_name, remote_node_namespace))


def get_action_server_names_and_types_by_node(
    node: GraphMethods, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node offers, with their types.

    Raises NodeNameNonExistentError for an unknown node.
    """
    read = node.get_publisher_names_and_types_by_node
    return _actions(read(remote_node_name, remote_node_namespace))


def get_action_names_and_types(node: GraphMethods) -> NamesAndTypes:
    """All actions, of servers and of clients, with their types."""
    return _actions(node.get_topic_names_and_types())


def _actions(topics: Iterable[tuple[str, list[str]]]) -> NamesAndTypes:
    found: dict[str, list[str]] = {}
    for topic, type_names in topics:
        for type_name in type_names:
            if (action := action_of_feedback(topic, type_name)) is not None:
                found.setdefault(action[0], []).append(action[1])
    return list(found.items())
