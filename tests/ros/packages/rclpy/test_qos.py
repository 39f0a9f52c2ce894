"""Profiles, policies and their compatibility are as in rclpy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc import QoS
from taskrpc.ros.packages.rclpy import qos
from taskrpc.ros.packages.rclpy.duration import Duration
from taskrpc.ros.packages.rclpy.impl.implementation_singleton import rclpy_implementation
from taskrpc.ros.packages.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    InvalidQoSProfileException,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
)

durations = st.integers(0, 2**63 - 1).map(lambda n: Duration(nanoseconds=n))
profiles = st.builds(
    QoSProfile,
    history=st.sampled_from(HistoryPolicy),
    depth=st.integers(1, 5000),
    reliability=st.sampled_from(ReliabilityPolicy),
    durability=st.sampled_from(DurabilityPolicy),
    lifespan=durations,
    deadline=durations,
    liveliness=st.sampled_from(LivelinessPolicy),
    liveliness_lease_duration=durations,
    avoid_ros_namespace_conventions=st.booleans(),
)


@given(profiles)
def test_a_profile_is_what_its_policies_make_it(profile):
    assert QoSProfile(**profile.get_c_qos_profile().to_dict()) == profile
    assert len(QoSProfile.__slots__) == len(profile.to_dict())


@given(profiles, profiles)
def test_profiles_are_equal_when_every_policy_is(one, other):
    assert (one == other) == (one.to_dict() == other.to_dict())
    assert one != "a profile"


@pytest.mark.parametrize(
    ("policies", "problem"),
    [
        ({}, "History and/or depth settings are required."),
        ({"history": HistoryPolicy.KEEP_LAST}, "History set to KEEP_LAST without a depth setting."),
    ],
)
def test_a_history_or_depth_is_needed(policies, problem):
    with pytest.raises(InvalidQoSProfileException) as raised:
        QoSProfile(**policies)
    assert str(raised.value) == problem


def test_depth_of_zero_warns():
    with pytest.warns(UserWarning, match="zero depth"):
        QoSProfile(depth=0)


def test_a_profile_prints_its_policies():
    assert str(QoSProfile(depth=1, reliability=2)).startswith(
        "QoSProfile(history=1, depth=1, reliability=2, durability=2, lifespan=0 nanoseconds,"
    )


@pytest.mark.parametrize(
    ("profile", "publisher", "subscription"),
    [
        (qos.qos_profile_default, QoS(10), QoS(10)),
        (qos.qos_profile_system_default, QoS(10), QoS(10)),
        (qos.qos_profile_sensor_data, *[QoS(5, "best_effort")] * 2),
        (qos.qos_profile_rosout_default, *[QoS(1000, durability="transient_local")] * 2),
        (QoSProfile(history=HistoryPolicy.KEEP_ALL), QoS(5000), QoS(5000)),
        (QoSProfile(depth=2**40), QoS(2**31 - 1), QoS(2**31 - 1)),
        (
            qos.qos_profile_best_available,
            QoS(10, "reliable", "transient_local"),
            QoS(10, "best_effort", "volatile"),
        ),
    ],
)
def test_a_profile_becomes_one_of_taskrpc(profile, publisher, subscription):
    assert profile.to_native() == publisher
    assert profile.to_native(subscribes=True) == subscription


def test_profiles_have_their_names_from_c():
    found = rclpy_implementation.rmw_qos_profile_t.predefined("qos_profile_sensor_data")
    assert QoSProfile(**found.to_dict()) == qos_profile_sensor_data
    with pytest.raises(ValueError, match="unknown rmw_qos_profile: nothing"):
        rclpy_implementation.rmw_qos_profile_t.predefined("nothing")
