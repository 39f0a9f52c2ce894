"""The graph lists actions by their feedback topics."""

import pytest

from taskrpc.ros.packages.rclpy.action import (
    get_action_client_names_and_types_by_node,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from taskrpc.ros.packages.rclpy.exceptions import NodeNameNonExistentError
from tests.ros.packages.rclpy.action.actions import action

pytestmark = pytest.mark.real_time


def test_actions_are_listed_for_all_nodes_and_by_node():
    with action() as pair:
        node, found = pair.served, [("/fibonacci", ["example_interfaces/action/Fibonacci"])]
        clients, servers = (
            get_action_client_names_and_types_by_node,
            get_action_server_names_and_types_by_node,
        )
        assert get_action_names_and_types(node) == node.get_action_names_and_types() == found
        assert (servers(node, "served", "/"), servers(node, "calling", "/")) == (found, [])
        assert (clients(node, "served", "/"), clients(node, "calling", "/")) == ([], found)
        with pytest.raises(NodeNameNonExistentError):
            servers(node, "nobody", "/")
        pair.server.destroy()
        pair.client.destroy()
        assert get_action_names_and_types(node) == []
