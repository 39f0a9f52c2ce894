"""The policies of a QoS profile: their values, and which values of two sides are compatible."""

from __future__ import annotations

import enum
import warnings
from typing import Any, NamedTuple, Protocol

from ...duration import Duration


class QoSPolicyKind(enum.IntEnum):
    """Names of policies: what an event or an overriding option is about."""

    INVALID = 1 << 0
    DURABILITY = 1 << 1
    DEADLINE = 1 << 2
    LIVELINESS = 1 << 3
    RELIABILITY = 1 << 4
    HISTORY = 1 << 5
    LIFESPAN = 1 << 6
    DEPTH = 1 << 7
    LIVELINESS_LEASE_DURATION = 1 << 8
    AVOID_ROS_NAMESPACE_CONVENTIONS = 1 << 9


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    """The name of a kind given by its number."""
    return QoSPolicyKind(policy_kind).name


class _PolicyType(enum.EnumType):
    """Lets programs of long ago write RMW_QOS_POLICY_HISTORY_KEEP_LAST, with a warning."""

    def __getattr__(cls, name: str) -> Any:
        kind = cls.__name__.removesuffix("Policy")
        short = name.removeprefix(f"RMW_QOS_POLICY_{kind.upper()}_")
        if short == name or short not in cls.__members__:
            raise AttributeError(f"type object {cls.__name__!r} has no attribute {name!r}")
        warnings.warn(
            f"{cls.__name__}.{name} is deprecated. Use {cls.__name__}.{short} instead.",
            stacklevel=2,
        )
        return cls[short]


class QoSPolicyEnum(enum.IntEnum, metaclass=_PolicyType):
    """What the policies have in common: names that a person can type."""

    @classmethod
    def short_keys(cls) -> list[str]:
        """The names as a person types them."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """The number of a name, in any case of letters. Raises KeyError."""
        return cls[name.upper()].value

    @property
    def short_key(self) -> str:
        """The name as a person types it."""
        return self.name.lower()


class HistoryPolicy(QoSPolicyEnum):
    """How many messages are kept."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(QoSPolicyEnum):
    """Whether every message arrives."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class DurabilityPolicy(QoSPolicyEnum):
    """Whether those who come later are given the last messages."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class LivelinessPolicy(QoSPolicyEnum):
    """Who says that a publisher is alive."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


DeadlineBestAvailable = Duration(nanoseconds=2**63 - 2)
"""The deadline that fits most of the other side."""
LivelinessLeaseDurationeBestAvailable = Duration(nanoseconds=2**63 - 2)
"""The lease that fits most of the other side (rclpy's spelling)."""


class Profile(Protocol):
    """The policies of a profile that decide whether two sides are compatible."""

    @property
    def reliability(self) -> ReliabilityPolicy:
        """Whether every message arrives."""

    @property
    def durability(self) -> DurabilityPolicy:
        """Whether late subscriptions receive the last messages."""

    @property
    def deadline(self) -> Duration:
        """The longest time between two messages."""

    @property
    def liveliness(self) -> LivelinessPolicy:
        """Who declares that the publisher is alive."""

    @property
    def liveliness_lease_duration(self) -> Duration:
        """The longest time between two such declarations."""


_BEST_EFFORT, _RELIABLE = ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE
_VOLATILE, _TRANSIENT_LOCAL = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL
_AUTOMATIC, _MANUAL = LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC
_UNSPECIFIED = Duration()


def incompatibilities(offered: Profile, asked: Profile) -> list[str]:
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


def possible_incompatibilities(offered: Profile, asked: Profile) -> list[str]:
    """Why it cannot be told, where a policy is left to the system."""
    return [text for doubt in _DOUBTS if (text := doubt.about(offered, asked))]


class _Doubt(NamedTuple):
    """A policy of which a weak publisher cannot serve a strong subscription."""

    policy: str
    weak: QoSPolicyEnum
    weak_text: str
    strong: QoSPolicyEnum
    strong_text: str

    def about(self, offered_profile: Profile, asked_profile: Profile) -> str:
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
