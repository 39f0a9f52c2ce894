"""Programs are told of the parameters of the nodes that they name."""

import pytest

from taskrpc.rclpy.parameter_event_handler import ParameterEvent, ParameterEventHandler


class Node:
    """As much of a node as the handler needs: it hands over the subscription's callback."""

    def create_subscription(self, message, topic, callback, qos, **settings):
        self.publish = callback


@pytest.fixture
def node():
    return Node()


def test_a_filter_leaves_the_nodes_that_it_names_and_none_leaves_all(node):
    handler, told = ParameterEventHandler(node), []
    handler.add_parameter_event_callback(lambda event: told.append(event.node))
    assert handler.configure_nodes_filter(["/b"])
    node.publish(ParameterEvent(node="/a"))
    node.publish(ParameterEvent(node="/b"))
    assert told == ["/b"]
    assert handler.configure_nodes_filter()
    node.publish(ParameterEvent(node="/a"))
    assert told == ["/b", "/a"]
