"""The kinds of policies of a QoS profile, and what each can be."""

from __future__ import annotations

import enum
import warnings
from typing import Any

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
