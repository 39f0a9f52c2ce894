"""Which profiles find each other, in the words of ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ...duration import Duration
from .qos_policies import DurabilityPolicy, LivelinessPolicy, QoSPolicyEnum, ReliabilityPolicy

if TYPE_CHECKING:
    from ...qos import QoSProfile

_BEST_EFFORT, _RELIABLE = ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE
_VOLATILE, _TRANSIENT_LOCAL = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL
_AUTOMATIC, _MANUAL = LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC
_UNSPECIFIED = Duration()


def errors(offered: QoSProfile, asked: QoSProfile) -> list[str]:
    """Why a publisher that offers one cannot serve a subscription that asks for the other."""
    lease, wanted_lease = offered.liveliness_lease_duration, asked.liveliness_lease_duration
    cases = {
        "Best effort publisher and reliable subscription": (
            offered.reliability == _BEST_EFFORT and asked.reliability == _RELIABLE
        ),
        "Volatile publisher and transient local subscription": (
            offered.durability == _VOLATILE and asked.durability == _TRANSIENT_LOCAL
        ),
        "Subscription has a deadline, but publisher does not": _lacks(
            offered.deadline, asked.deadline
        ),
        "Subscription deadline is less than publisher deadline": _exceeds(
            offered.deadline, asked.deadline
        ),
        "Publisher's liveliness is automatic and subscription's is manual by topic": (
            offered.liveliness == _AUTOMATIC and asked.liveliness == _MANUAL
        ),
        "Subscription has a liveliness lease duration, but publisher does not": _lacks(
            lease, wanted_lease
        ),
        "Subscription liveliness lease duration is less than publisher": _exceeds(
            lease, wanted_lease
        ),
    }
    return [text for text, applies in cases.items() if applies]


def warnings_of(offered: QoSProfile, asked: QoSProfile) -> list[str]:
    """Why it cannot be told, where a policy is left to the system."""
    return [text for doubt in _DOUBTS if (text := doubt.about(offered, asked))]


class _Doubt(NamedTuple):
    """A policy of which a weak publisher cannot serve a strong subscription."""

    policy: str
    weak: QoSPolicyEnum
    weak_text: str
    strong: QoSPolicyEnum
    strong_text: str

    def about(self, offered_profile: QoSProfile, asked_profile: QoSProfile) -> str:
        """The sentence of it; empty where both sides are known or it does not matter."""
        offered: QoSPolicyEnum = getattr(offered_profile, self.policy)
        asked: QoSPolicyEnum = getattr(asked_profile, self.policy)
        if _is_open(offered) and _is_open(asked):
            return (
                f"Publisher {self.policy} is {offered.short_key}"
                f" and subscription {self.policy} is {asked.short_key}"
            )
        if _is_open(offered) and asked == self.strong:
            return f"{self.strong_text} is {offered.short_key}"
        if offered == self.weak and _is_open(asked):
            return f"{self.weak_text} is {asked.short_key}"
        return ""


_DOUBTS = (
    _Doubt(
        "reliability",
        _BEST_EFFORT,
        "Best effort publisher, but subscription",
        _RELIABLE,
        "Reliable subscription, but publisher",
    ),
    _Doubt(
        "durability",
        _VOLATILE,
        "Volatile publisher, but subscription",
        _TRANSIENT_LOCAL,
        "Transient local subscription, but publisher",
    ),
    _Doubt(
        "liveliness",
        _AUTOMATIC,
        "Publisher's liveliness is automatic, but subscription's",
        _MANUAL,
        "Subscription's liveliness is manual by topic, but publisher's",
    ),
)


def _is_open(policy: QoSPolicyEnum) -> bool:
    return policy.name in ("SYSTEM_DEFAULT", "UNKNOWN")


def _lacks(offered: Duration, asked: Duration) -> bool:
    return offered == _UNSPECIFIED != asked


def _exceeds(offered: Duration, asked: Duration) -> bool:
    return _UNSPECIFIED not in (offered, asked) and asked < offered
