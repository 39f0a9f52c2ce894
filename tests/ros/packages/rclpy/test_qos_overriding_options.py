"""Parameters override the QoS of a topic where the program allows it."""

import pytest

import srvgen
from taskrpc.ros.packages.rclpy.duration import Duration
from taskrpc.ros.packages.rclpy.node import Node
from taskrpc.ros.packages.rclpy.parameter import Parameter
from taskrpc.ros.packages.rclpy.publisher import Publisher
from taskrpc.ros.packages.rclpy.qos import (
    LivelinessPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from taskrpc.ros.packages.rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QosCallbackResult,
    QoSOverridingOptions,
    _declare_qos_parameters,
)

pytestmark = pytest.mark.real_time

String = srvgen.load("std_msgs/msg/String")


def node_with(context, **overrides):
    given = [
        Parameter(f"qos_overrides./chatter.publisher.{name}", value=value)
        for name, value in overrides.items()
    ]
    return Node("n", context=context, parameter_overrides=given)


def declared(node):
    found = node.get_parameters_by_prefix("qos_overrides")
    return {name.removeprefix("/chatter."): one.value for name, one in found.items()}


def test_policies_of_a_topic_are_parameters(context):
    node = Node("n", context=context)
    options = QoSOverridingOptions.with_default_policies(entity_id="left")
    node.create_publisher(String, "chatter", 10, qos_overriding_options=options)
    node.create_subscription(
        String,
        "chatter",
        print,
        5,
        qos_overriding_options=QoSOverridingOptions(set(QoSPolicyKind) - {QoSPolicyKind.INVALID}),
    )
    assert declared(node) == {
        "publisher_left.history": "keep_last",
        "publisher_left.depth": 10,
        "publisher_left.reliability": "reliable",
        "subscription.durability": "volatile",
        "subscription.deadline": 0,
        "subscription.liveliness": "system_default",
        "subscription.reliability": "reliable",
        "subscription.history": "keep_last",
        "subscription.depth": 5,
        "subscription.liveliness_lease_duration": 0,
        "subscription.avoid_ros_namespace_conventions": False,
    }


def test_overrides_change_the_profile(context):
    node = node_with(
        context, depth=100, reliability="best_effort", lifespan=5, liveliness="automatic"
    )
    kinds = [QoSPolicyKind[name] for name in "DEPTH RELIABILITY LIFESPAN LIVELINESS".split()]
    for _ in range(2):  # the second time the parameters exist already
        profile = QoSProfile(depth=10)
        publisher = node.create_publisher(
            String, "/chatter", profile, qos_overriding_options=QoSOverridingOptions(kinds)
        )
        assert publisher.qos_profile == QoSProfile(
            depth=100,
            reliability=ReliabilityPolicy.BEST_EFFORT,
            lifespan=Duration(nanoseconds=5),
            liveliness=LivelinessPolicy.AUTOMATIC,
        )


def test_the_program_can_refuse_a_profile(context):
    def validate(profile):
        return QosCallbackResult(successful=profile.depth < 50, reason="too deep")

    options = QoSOverridingOptions.with_default_policies(callback=validate)
    with pytest.raises(InvalidQosOverridesError) as caught:
        node_with(context, depth=100).create_publisher(
            String, "chatter", 10, qos_overriding_options=options
        )
    assert str(caught.value) == (
        "Provided QoS overrides for publisher `/chatter` with id `None`, are not valid: too deep"
    )
    Node("m", context=context).create_publisher(
        String, "chatter", 10, qos_overriding_options=options
    )


def test_an_unknown_policy_is_reported(context):
    options = QoSOverridingOptions.with_default_policies()
    with pytest.raises(RuntimeError, match="policy `reliability`: `mostly`"):
        node_with(context, reliability="mostly").create_publisher(
            String, "chatter", 10, qos_overriding_options=options
        )


def test_only_publishers_and_subscriptions_have_them(context):
    with pytest.raises(TypeError, match="subclass of Publisher or Subscription"):
        _declare_qos_parameters(
            Node,
            Node("n", context=context),
            "/chatter",
            QoSProfile(depth=1),
            QoSOverridingOptions.with_default_policies(),
        )
    profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.UNKNOWN)
    with pytest.raises(ValueError, match="User provided QoS profile is invalid"):
        _declare_qos_parameters(
            Publisher,
            Node("m", context=context),
            "/chatter",
            profile,
            QoSOverridingOptions.with_default_policies(),
        )
