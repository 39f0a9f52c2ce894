"""The policies of a QoS profile: their values, and which values of two sides are compatible."""

from __future__ import annotations

import enum
import warnings
from typing import Any, NamedTuple, Protocol

from ...duration import Duration


class QoSPolicyKind(enum.IntEnum):
    """The policies, for events and overriding options."""

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
    """The name of a kind, such as `DURABILITY`. Raises ValueError for an unknown number."""
    return QoSPolicyKind(policy_kind).name


class _PolicyType(enum.EnumType):
    """Accepts the old names, such as RMW_QOS_POLICY_HISTORY_KEEP_LAST, with a warning."""

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
    """The base of the policies: adds short names, such as `keep_last`."""

    @classmethod
    def short_keys(cls) -> list[str]:
        """The short names of all values."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """The number of a short name, in lower or upper case; raises KeyError for another name."""
        return cls[name.upper()].value

    @property
    def short_key(self) -> str:
        """The short name."""
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
    """Whether a late subscription receives the last messages."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class LivelinessPolicy(QoSPolicyEnum):
    """Who declares that a publisher is alive: the middleware or the program."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


DeadlineBestAvailable = Duration(nanoseconds=2**63 - 2)
"""The deadline that matches as many endpoints of the other side as possible."""
LivelinessLeaseDurationeBestAvailable = Duration(nanoseconds=2**63 - 2)
"""The same for the lease. The misspelt name is that of rclpy."""


class Profile(Protocol):
    """The policies of a profile that decide whether two sides are compatible."""

    @property
    def reliability(self) -> ReliabilityPolicy:
        """Whether every message arrives."""

    @property
    def durability(self) -> DurabilityPolicy:
        """Whether a late subscription receives the last messages."""

    @property
    def deadline(self) -> Duration:
        """The longest time between two messages."""

    @property
    def liveliness(self) -> LivelinessPolicy:
        """Who declares that the publisher is alive: the middleware or the program."""

    @property
    def liveliness_lease_duration(self) -> Duration:
        """The longest time between two such declarations."""


_BEST_EFFORT, _RELIABLE = ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE
_VOLATILE, _TRANSIENT_LOCAL = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL
_AUTOMATIC, _MANUAL = LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC
_UNSPECIFIED = Duration()


def incompatibilities(offered: Profile, requested: Profile) -> list[str]:
    """Why a publisher with one profile cannot serve a subscription with the other."""
    lease, requested_lease = offered.liveliness_lease_duration, requested.liveliness_lease_duration
    cases = {
        "Best effort publisher and reliable subscription": (
            offered.reliability == _BEST_EFFORT and requested.reliability == _RELIABLE
        ),
        "Volatile publisher and transient local subscription": (
            offered.durability == _VOLATILE and requested.durability == _TRANSIENT_LOCAL
        ),
        "Subscription has a deadline, but publisher does not": _lacks(
            offered.deadline, requested.deadline
        ),
        "Subscription deadline is less than publisher deadline": _exceeds(
            offered.deadline, requested.deadline
        ),
        "Publisher's liveliness is automatic and subscription's is manual by topic": (
            offered.liveliness == _AUTOMATIC and requested.liveliness == _MANUAL
        ),
        "Subscription has a liveliness lease duration, but publisher does not": _lacks(
            lease, requested_lease
        ),
        "Subscription liveliness lease duration is less than publisher": _exceeds(
            lease, requested_lease
        ),
    }
    return [text for text, applies in cases.items() if applies]


def possible_incompatibilities(offered: Profile, requested: Profile) -> list[str]:
    """Why the profiles may be incompatible: a policy is unknown or left to the system."""
    return [text for doubt in _DOUBTS if (text := doubt.sentence(offered, requested))]


class _Doubt(NamedTuple):
    """A policy for which a weak publisher cannot serve a strong subscription."""

    policy: str
    weak: QoSPolicyEnum
    weak_text: str
    strong: QoSPolicyEnum
    strong_text: str

    def sentence(self, offered_profile: Profile, requested_profile: Profile) -> str:
        """The sentence about this policy; empty if the policy cannot be the problem."""
        offered: QoSPolicyEnum = getattr(offered_profile, self.policy)
        requested: QoSPolicyEnum = getattr(requested_profile, self.policy)
        if _is_undetermined(offered) and _is_undetermined(requested):
            return (
                f"Publisher {self.policy} is {offered.short_key}"
                f" and subscription {self.policy} is {requested.short_key}"
            )
        if _is_undetermined(offered) and requested == self.strong:
            return f"{self.strong_text} is {offered.short_key}"
        if offered == self.weak and _is_undetermined(requested):
            return f"{self.weak_text} is {requested.short_key}"
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


def _is_undetermined(policy: QoSPolicyEnum) -> bool:
    return policy.name in ("SYSTEM_DEFAULT", "UNKNOWN")


def _lacks(offered: Duration, requested: Duration) -> bool:
    return offered == _UNSPECIFIED != requested


def _exceeds(offered: Duration, requested: Duration) -> bool:
    return _UNSPECIFIED not in (offered, requested) and requested < offered
