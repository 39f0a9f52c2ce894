"""The policies of a profile, and which of them are compatible."""

import pytest

from taskrpc.ros.packages.rclpy import qos
from taskrpc.ros.packages.rclpy.duration import Duration
from taskrpc.ros.packages.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)


@pytest.mark.parametrize(
    "policies",
    [{"depht": 1}, {"depth": "1"}, {"depth": 1, "reliability": "x"}, {"depth": 1, "deadline": 1}],
)
def test_what_is_no_policy_is_refused(policies):
    with pytest.raises(AssertionError):
        QoSProfile(**policies)


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
