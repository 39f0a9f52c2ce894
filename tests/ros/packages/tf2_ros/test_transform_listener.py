"""Listeners and broadcasters: topics, QoS, and what they pass on."""

import pytest


def described(each, ros):
    durable = each.qos.durability == ros.qos.DurabilityPolicy.TRANSIENT_LOCAL
    reliable = each.qos.reliability == ros.qos.ReliabilityPolicy.RELIABLE
    return each.topic, each.qos.depth, durable, reliable


def test_listener_subscribes_with_tf2s_qos(ros, node):
    ros.tf2_ros.TransformListener(ros.tf2_ros.Buffer(), node)
    assert [described(each, ros) for each in node.made] == [
        ("/tf", 100, False, True),
        ("/tf_static", 100, True, True),
    ]
    assert {type(each.group).__name__ for each in node.made} == {"ReentrantCallbackGroup"}


def test_listener_fills_its_buffer(ros, node, link):
    buffer = ros.tf2_ros.Buffer()
    listener = ros.tf2_ros.TransformListener(buffer, node)
    moving, static = node.made
    moving.callback(ros.TFMessage(transforms=[link("a", "b"), link("b", "c")]))
    static.callback(ros.TFMessage(transforms=[link("c", "d")]))
    assert buffer.lookup_transform("a", "d", ros.Time()).header.stamp.sec == 1
    assert "broadcaster: 'default_authority'" in buffer.all_frames_as_yaml()
    listener.unregister()
    assert node.destroyed == node.made


def test_topics_and_qos_can_be_chosen(ros, node):
    buffer = ros.tf2_ros.Buffer()
    ros.tf2_ros.TransformListener(
        buffer, node, qos=3, static_qos=4, tf_topic="tf", tf_static_topic="tf_static"
    )
    assert [(each.topic, each.qos) for each in node.made] == [("tf", 3), ("tf_static", 4)]


def test_static_listener_subscribes_only_to_static_transforms(ros, node):
    listener = ros.tf2_ros.StaticTransformListener(ros.tf2_ros.Buffer(), node)
    assert [each.topic for each in node.made] == ["/tf_static"]
    listener.unregister()
    assert node.destroyed == node.made


@pytest.mark.parametrize(
    ("name", "topic", "depth", "durable"),
    [
        ("TransformBroadcaster", "/tf", 100, False),
        ("StaticTransformBroadcaster", "/tf_static", 1, True),
    ],
)
def test_broadcasters_send_one_transform_or_several(ros, node, link, name, topic, depth, durable):
    broadcaster = getattr(ros.tf2_ros, name)(node)
    (publisher,) = node.made
    assert described(publisher, ros) == (topic, depth, durable, True)
    one, two = link("a", "b"), link("a", "c")
    for given in (one, [one, two], (one, two), iter([one, two])):
        broadcaster.sendTransform(given)
    assert [len(message.transforms) for message in publisher.sent] == [1, 2, 2, 2]
    assert publisher.sent[1].transforms[1] == two


def test_static_broadcaster_repeats_what_it_has_sent(ros, node, link):
    broadcaster = ros.tf2_ros.StaticTransformBroadcaster(node)
    for sent in (link("a", "b", x=1.0), link("a", "c"), link("a", "b", x=2.0)):
        broadcaster.sendTransform(sent)
    messages = [
        [(each.child_frame_id, each.transform.translation.x) for each in message.transforms]
        for message in node.made[0].sent
    ]
    assert messages == [[("b", 1.0)], [("b", 1.0), ("c", 0.0)], [("b", 2.0), ("c", 0.0)]]


def test_names_of_other_packages_can_be_imported_from_tf2(ros):
    for package in (ros.tf2_ros, ros.module("tf2_geometry_msgs")):
        for name in ("PointStamped", "PoseStamped", "TransformStamped", "Vector3Stamped"):
            assert getattr(package, name) is getattr(ros.geometry, name)
    assert (ros.tf2_ros.Duration, ros.tf2_ros.Time) == (ros.Duration, ros.Time)


def test_modules_have_the_names_of_ros(ros):
    for module, name in (
        ("buffer", "Buffer"),
        ("buffer_client", "BufferClient"),
        ("buffer_interface", "BufferInterface"),
        ("transform_listener", "TransformListener"),
        ("transform_broadcaster", "TransformBroadcaster"),
        ("static_transform_broadcaster", "StaticTransformBroadcaster"),
        ("static_transform_listener", "StaticTransformListener"),
    ):
        found = getattr(ros.module(f"tf2_ros.{module}"), name)
        assert found is getattr(ros.tf2_ros, name)
    for name in ("Lookup", "Connectivity", "Extrapolation", "InvalidArgument", "Timeout"):
        kind = getattr(ros.tf2_ros, f"{name}Exception")
        assert issubclass(kind, ros.tf2_ros.TransformException)
        assert f"{kind.__module__}.{kind.__name__}" == f"tf2.{name}Exception"
