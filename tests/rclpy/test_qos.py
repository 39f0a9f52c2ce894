"""Profiles, policies and who finds whom are as in rclpy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc import QoS
from taskrpc.rclpy import qos
from taskrpc.rclpy.duration import Duration
from taskrpc.rclpy.impl.implementation_singleton import rclpy_implementation
from taskrpc.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    InvalidQoSProfileException,
    LivelinessPolicy,
    QoSCompatibility,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
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


@pytest.mark.parametrize("policies", [{}, {"history": HistoryPolicy.KEEP_LAST}])
def test_a_history_or_depth_is_needed(policies):
    with pytest.raises(InvalidQoSProfileException, match="Invalid QoSProfile"):
        QoSProfile(**policies)


@pytest.mark.parametrize(
    "policies",
    [{"depht": 1}, {"depth": "1"}, {"depth": 1, "reliability": "x"}, {"depth": 1, "deadline": 1}],
)
def test_what_is_no_policy_is_refused(policies):
    with pytest.raises(AssertionError):
        QoSProfile(**policies)


def test_a_depth_of_zero_is_warned_of():
    with pytest.warns(UserWarning, match="zero depth"):
        QoSProfile(depth=0)


def test_policies_are_typed_by_short_names():
    assert HistoryPolicy.short_keys() == ["system_default", "keep_last", "keep_all", "unknown"]
    assert HistoryPolicy.get_from_short_key("KEEP_last") == HistoryPolicy.KEEP_LAST.value
    assert ReliabilityPolicy.BEST_EFFORT.short_key == "best_effort"
    assert QoSPresetProfiles.get_from_short_key("sensor_data") is qos.qos_profile_sensor_data
    assert set(QoSPresetProfiles.short_keys()) > {"default", "parameters", "rosout_default"}
    assert qos.qos_policy_name_from_kind(1 << 7) == "DEPTH"


def test_names_of_long_ago_are_known_with_a_warning():
    with pytest.warns(UserWarning, match=r"Use HistoryPolicy.KEEP_ALL instead"):
        assert HistoryPolicy.RMW_QOS_POLICY_HISTORY_KEEP_ALL is HistoryPolicy.KEEP_ALL
    with pytest.raises(AttributeError, match="RMW_QOS_POLICY_HISTORY_LATEST"):
        _ = HistoryPolicy.RMW_QOS_POLICY_HISTORY_LATEST


def test_a_profile_prints_its_policies():
    assert str(QoSProfile(depth=1, reliability=2)).startswith(
        "QoSProfile(history=1, depth=1, reliability=2, durability=2, lifespan=0 nanoseconds,"
    )


@pytest.mark.parametrize(
    ("offered", "asked", "answer"),
    [
        ({}, {}, (QoSCompatibility.OK, "")),
        (
            {"reliability": ReliabilityPolicy.BEST_EFFORT},
            {"reliability": ReliabilityPolicy.RELIABLE},
            (QoSCompatibility.ERROR, "ERROR: Best effort publisher and reliable subscription;"),
        ),
        (
            {"deadline": Duration(seconds=2)},
            {"durability": DurabilityPolicy.TRANSIENT_LOCAL, "deadline": Duration(seconds=1)},
            (
                QoSCompatibility.ERROR,
                "ERROR: Volatile publisher and transient local subscription;"
                "ERROR: Subscription deadline is less than publisher deadline;",
            ),
        ),
        (
            {},
            {"liveliness_lease_duration": Duration(seconds=1)},
            (
                QoSCompatibility.ERROR,
                "ERROR: Subscription has a liveliness lease duration, but publisher does not;",
            ),
        ),
        (
            {"reliability": ReliabilityPolicy.SYSTEM_DEFAULT},
            {"durability": DurabilityPolicy.SYSTEM_DEFAULT},
            (
                QoSCompatibility.WARNING,
                "WARNING: Reliable subscription, but publisher is system_default;"
                "WARNING: Volatile publisher, but subscription is system_default;",
            ),
        ),
        (
            {"liveliness": LivelinessPolicy.SYSTEM_DEFAULT},
            {"liveliness": LivelinessPolicy.MANUAL_BY_TOPIC},
            (
                QoSCompatibility.WARNING,
                "WARNING: Subscription's liveliness is manual by topic, but publisher's is"
                " system_default;",
            ),
        ),
        (
            {"liveliness": LivelinessPolicy.SYSTEM_DEFAULT},
            {"liveliness": LivelinessPolicy.UNKNOWN},
            (
                QoSCompatibility.WARNING,
                "WARNING: Publisher liveliness is system_default and subscription liveliness is"
                " unknown;",
            ),
        ),
    ],
)
def test_a_publisher_must_offer_at_least_what_a_subscription_requests(offered, asked, answer):
    sure = {"depth": 1, "liveliness": LivelinessPolicy.AUTOMATIC}
    assert qos_check_compatible(QoSProfile(**sure | offered), QoSProfile(**sure | asked)) == answer


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


def test_profiles_are_known_by_their_names_in_c():
    found = rclpy_implementation.rmw_qos_profile_t.predefined("qos_profile_sensor_data")
    assert QoSProfile(**found.to_dict()) == qos_profile_sensor_data
    with pytest.raises(ValueError, match="unknown rmw_qos_profile: nothing"):
        rclpy_implementation.rmw_qos_profile_t.predefined("nothing")
