"""`ParameterEventHandler` calls back for changed parameters of the selected nodes."""

import pytest

from taskrpc.ros.packages.rclpy.parameter_event_handler import ParameterEvent, ParameterEventHandler


class Node:
    """The part of a node that the handler uses; it keeps the callback of the subscription."""

    def create_subscription(self, message, topic, callback, qos, **settings):
        self.publish = callback


@pytest.fixture
def node():
    return Node()


def test_filter_selects_the_named_nodes_and_no_filter_selects_all(node):
    handler, told = ParameterEventHandler(node), []
    handler.add_parameter_event_callback(lambda event: told.append(event.node))
    assert handler.configure_nodes_filter(["/b"])
    node.publish(ParameterEvent(node="/a"))
    node.publish(ParameterEvent(node="/b"))
    assert told == ["/b"]
    assert handler.configure_nodes_filter()
    node.publish(ParameterEvent(node="/a"))
    assert told == ["/b", "/a"]
