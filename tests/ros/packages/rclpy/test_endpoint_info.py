"""The description of a publisher or a subscription."""

import pytest

from taskrpc.ros.packages.rclpy.topic_endpoint_info import TopicEndpointInfo, TopicEndpointTypeEnum


def test_endpoint_info_accepts_plain_data_for_its_fields():
    info = TopicEndpointInfo(
        node_name="a", endpoint_type=1, topic_type_hash={"version": 1, "value": bytes(32)}
    )
    assert info.endpoint_type is TopicEndpointTypeEnum.PUBLISHER
    assert str(info.topic_type_hash) == "RIHS01_" + "00" * 32
    assert TopicEndpointInfo() == TopicEndpointInfo()
    assert "Endpoint type: INVALID\nGID: \nQoS profile:" in str(TopicEndpointInfo())
    with pytest.raises(AssertionError):
        info.node_name = 7
