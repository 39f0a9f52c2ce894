"""A QoS is what ROS's names say, and nothing else is one."""

from types import SimpleNamespace

import pytest

from taskrpc import QoS
from taskrpc.qos import qos_for_all, qos_of


def test_a_depth_alone_means_reliable_and_volatile():
    assert qos_of(7) == QoS(7, "reliable", "volatile")
    assert qos_of(QoS(2)) == QoS(2)
    assert QoS().is_reliable
    assert not QoS().is_latched
    assert QoS(durability="transient_local").is_latched


@pytest.mark.parametrize("depth", [0, -1, 1.5, "10", True, 2**31])
def test_a_depth_is_a_number_from_1_on(depth):
    with pytest.raises(ValueError, match=r"depth: expected a number from 1 on, got"):
        qos_of(depth)


def test_unknown_reliability_or_durability_is_refused_by_name():
    with pytest.raises(ValueError, match=r"reliability: expected 'reliable' or 'best_effort'"):
        QoS(reliability="good")
    with pytest.raises(ValueError, match=r"durability: expected 'volatile' or 'transient_local'"):
        QoS(durability="latched")


@pytest.mark.parametrize(
    ("publishers", "expected"),
    [
        ([], QoS(5)),
        ([QoS()], QoS(5)),
        ([QoS(), QoS(reliability="best_effort")], QoS(5, "best_effort")),
        ([QoS(durability="transient_local")], QoS(5, durability="transient_local")),
        ([QoS(durability="transient_local"), QoS()], QoS(5)),
    ],
)
def test_subscription_for_all_publishers_requests_no_more_than_each_offers(publishers, expected):
    offers = [
        SimpleNamespace(reliable=each.is_reliable, latched=each.is_latched) for each in publishers
    ]
    assert qos_for_all(offers, 5) == expected
