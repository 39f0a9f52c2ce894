"""Programs find names where ROS's modules have them only because they import them."""

import importlib

import pytest

PLACES = [
    ("node", "Parameter ParameterType ParameterDescriptor SetParametersResult Client Publisher"),
    ("node", "MutuallyExclusiveCallbackGroup QoSProfile Timer Future SrvTypeRequest MsgType"),
    ("node", "ParameterNotDeclaredException ListParameters TopicEndpointInfo validate_topic_name"),
    ("client", "Future SrvType SrvTypeRequest SrvTypeResponse"),
    ("service", "SrvType SrvTypeRequest SrvTypeResponse"),
    ("publisher", "MsgType"),
    ("subscription", "MsgType"),
    ("qos_event", "PublisherEventCallbacks QoSRequestedIncompatibleQoSInfo QoSEventHandler"),
    ("event_handler", "QoSPublisherMatchedInfo QoSSubscriptionMatchedInfo QoSEventHandler"),
    ("event_handler", "QoSOfferedDeadlineMissedInfo QoSRequestedDeadlineMissedInfo"),
    ("event_handler", "QoSPublisherEventType QoSSubscriptionEventType EventHandler"),
    ("action.client", "ClientGoalHandle"),
    ("action.server", "ServerGoalHandle"),
]


@pytest.mark.parametrize(("module", "names"), PLACES)
def test_a_name_is_found_where_programs_import_it_from(module, names):
    module = importlib.import_module(f"taskrpc.ros.packages.rclpy.{module}")
    for name in names.split():
        assert getattr(module, name).__name__


def test_a_name_that_ros_has_nowhere_is_missing():
    node = importlib.import_module("taskrpc.ros.packages.rclpy.node")
    with pytest.raises(AttributeError, match="has no attribute 'Nodes'"):
        _ = node.Nodes
