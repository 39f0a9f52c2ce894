"""Quality of service profiles: what a publisher offers and a subscription requests."""

from __future__ import annotations

import enum
import warnings
from typing import Any, Self, TypeVar

from taskrpc.qos import MAX_DEPTH, QoS, Timing

from ._impl.graph.qos_policies import (
    DeadlineBestAvailable,
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessLeaseDurationeBestAvailable,
    LivelinessPolicy,
    QoSPolicyEnum,
    QoSPolicyKind,
    ReliabilityPolicy,
    incompatibilities,
    possible_incompatibilities,
    qos_policy_name_from_kind,
)
from .duration import Duration

__all__ = [
    "DeadlineBestAvailable",
    "DurabilityPolicy",
    "HistoryPolicy",
    "InvalidQoSProfileException",
    "LivelinessLeaseDurationeBestAvailable",
    "LivelinessPolicy",
    "QoSCompatibility",
    "QoSDurabilityPolicy",
    "QoSHistoryPolicy",
    "QoSLivelinessPolicy",
    "QoSPolicyEnum",
    "QoSPolicyKind",
    "QoSPresetProfiles",
    "QoSProfile",
    "QoSReliabilityPolicy",
    "ReliabilityPolicy",
    "qos_check_compatible",
    "qos_policy_name_from_kind",
    "qos_profile_action_status_default",
    "qos_profile_best_available",
    "qos_profile_default",
    "qos_profile_parameter_events",
    "qos_profile_parameters",
    "qos_profile_rosout_default",
    "qos_profile_sensor_data",
    "qos_profile_services_default",
    "qos_profile_system_default",
    "qos_profile_unknown",
]

_T = TypeVar("_T")

QoSHistoryPolicy = HistoryPolicy
QoSReliabilityPolicy = ReliabilityPolicy
QoSDurabilityPolicy = DurabilityPolicy
QoSLivelinessPolicy = LivelinessPolicy

_POLICIES = (
    "history",
    "depth",
    "reliability",
    "durability",
    "lifespan",
    "deadline",
    "liveliness",
    "liveliness_lease_duration",
    "avoid_ros_namespace_conventions",
)
_UNSPECIFIED = Duration()
_NO_LIMITS = Timing()
_DEFAULT_DEPTH = 10
_KEEP_ALL_DEPTH = 5000
"""With KEEP_ALL: a slow subscriber must not use up the memory; DDS has such a limit, too."""


class InvalidQoSProfileException(Exception):
    """A profile lacks a history or depth."""


class QoSProfile:
    """The policies of a publisher, a subscription, a client or a service.

    Give a depth (how many messages are kept), or `history=HistoryPolicy.KEEP_ALL`. The other
    policies default to those of `qos_profile_default`. In taskrpc, the lifespan has no effect.

    Raises InvalidQoSProfileException without depth and history, AssertionError for an unknown or
    invalid policy.
    """

    __slots__ = tuple(f"_{name}" for name in _POLICIES)

    def __init__(self, **kwargs: Any) -> None:
        if not all(name in _POLICIES for name in kwargs):
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()!r}")
        if "history" not in kwargs:
            if "depth" not in kwargs:
                raise InvalidQoSProfileException("History and/or depth settings are required.")
            kwargs["history"] = HistoryPolicy.KEEP_LAST
        self.history = kwargs["history"]
        if self.history == HistoryPolicy.KEEP_LAST and "depth" not in kwargs:
            raise InvalidQoSProfileException("History set to KEEP_LAST without a depth setting.")
        self.depth = kwargs.get("depth", _DEFAULT_DEPTH)
        self.reliability = kwargs.get("reliability", ReliabilityPolicy.RELIABLE)
        self.durability = kwargs.get("durability", DurabilityPolicy.VOLATILE)
        self.lifespan = kwargs.get("lifespan", _UNSPECIFIED)
        self.deadline = kwargs.get("deadline", _UNSPECIFIED)
        self.liveliness = kwargs.get("liveliness", LivelinessPolicy.SYSTEM_DEFAULT)
        self.liveliness_lease_duration = kwargs.get("liveliness_lease_duration", _UNSPECIFIED)
        self.avoid_ros_namespace_conventions = kwargs.get("avoid_ros_namespace_conventions", False)

    @property
    def history(self) -> HistoryPolicy:
        """Whether the last `depth` messages are kept, or all messages."""
        return self._history

    @history.setter
    def history(self, value: HistoryPolicy | int) -> None:
        self._history = HistoryPolicy(_checked(value, int))

    @property
    def depth(self) -> int:
        """How many messages are kept for a slow or late subscription."""
        return self._depth

    @depth.setter
    def depth(self, value: int) -> None:
        _checked(value, int)
        if self.history == HistoryPolicy.KEEP_LAST and value == 0:
            warnings.warn(
                "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
                "This will be interpreted as SYSTEM_DEFAULT",
                stacklevel=2,
            )
        self._depth = value

    @property
    def reliability(self) -> ReliabilityPolicy:
        """Whether every message arrives, or messages may be lost when a subscription is slow."""
        return self._reliability

    @reliability.setter
    def reliability(self, value: ReliabilityPolicy | int) -> None:
        self._reliability = ReliabilityPolicy(_checked(value, int))

    @property
    def durability(self) -> DurabilityPolicy:
        """Whether a late subscription receives the last messages."""
        return self._durability

    @durability.setter
    def durability(self, value: DurabilityPolicy | int) -> None:
        self._durability = DurabilityPolicy(_checked(value, int))

    @property
    def lifespan(self) -> Duration:
        """How long after its publication a message may be delivered; zero means no limit."""
        return self._lifespan

    @lifespan.setter
    def lifespan(self, value: Duration) -> None:
        self._lifespan = _checked(value, Duration)

    @property
    def deadline(self) -> Duration:
        """The longest time between two messages; zero means no limit."""
        return self._deadline

    @deadline.setter
    def deadline(self, value: Duration) -> None:
        self._deadline = _checked(value, Duration)

    @property
    def liveliness(self) -> LivelinessPolicy:
        """Who declares that a publisher is alive: the middleware or the program."""
        return self._liveliness

    @liveliness.setter
    def liveliness(self, value: LivelinessPolicy | int) -> None:
        self._liveliness = LivelinessPolicy(_checked(value, int))

    @property
    def liveliness_lease_duration(self) -> Duration:
        """The longest time between two such declarations; zero means no limit."""
        return self._liveliness_lease_duration

    @liveliness_lease_duration.setter
    def liveliness_lease_duration(self, value: Duration) -> None:
        self._liveliness_lease_duration = _checked(value, Duration)

    @property
    def avoid_ros_namespace_conventions(self) -> bool:
        """Whether the name of the topic is used unchanged, without the prefix of ROS."""
        return self._avoid_ros_namespace_conventions

    @avoid_ros_namespace_conventions.setter
    def avoid_ros_namespace_conventions(self, value: bool) -> None:
        self._avoid_ros_namespace_conventions = _checked(value, bool)

    def get_c_qos_profile(self) -> Self:
        """The profile itself; ROS returns a C object here. `to_dict()` has its policies."""
        return self

    def to_dict(self) -> dict[str, Any]:
        """The policies by name; `QoSProfile(**policies)` creates the same profile."""
        return {name: getattr(self, name) for name in _POLICIES}

    def to_native(self, *, subscribes: bool = False) -> QoS:
        """The profile for taskrpc's own publishers and subscriptions."""
        keeps_all = self.history == HistoryPolicy.KEEP_ALL
        reliable = self.reliability not in _unreliable(subscribes)
        latched = self.durability == DurabilityPolicy.TRANSIENT_LOCAL or (
            self.durability == DurabilityPolicy.BEST_AVAILABLE and not subscribes
        )
        return QoS(
            depth=_KEEP_ALL_DEPTH
            if keeps_all
            else min(self.depth or _DEFAULT_DEPTH, MAX_DEPTH - 1),
            reliability="reliable" if reliable else "best_effort",
            durability="transient_local" if latched else "volatile",
            timing=self.to_timing(),
        )

    def to_timing(self) -> Timing | None:
        """The deadline and the liveliness for taskrpc; None for the defaults."""
        is_manual = self.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
        timing = Timing(_limit(self.deadline), _limit(self.liveliness_lease_duration), is_manual)
        return None if timing == _NO_LIMITS else timing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        policies = ", ".join(f"{name}={value!s}" for name, value in self.to_dict().items())
        return f"{type(self).__name__}({policies})"

    __repr__ = __str__


def _limit(duration: Duration) -> int:
    """The nanoseconds of a limit; 0 for none. BEST_AVAILABLE matches every endpoint."""
    return 0 if duration >= DeadlineBestAvailable else duration.nanoseconds


def _checked(value: object, kind: type[_T]) -> _T:
    """The value; raises AssertionError for a value of another type, as rclpy does."""
    if not isinstance(value, kind):
        raise AssertionError(f"expected {kind.__name__}, got {value!r}")
    return value


def _unreliable(subscribes: bool) -> tuple[ReliabilityPolicy, ...]:
    """The reliabilities with which messages may be lost; BEST_AVAILABLE matches every endpoint."""
    if subscribes:
        return (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.BEST_AVAILABLE)
    return (ReliabilityPolicy.BEST_EFFORT,)


def _system_default(**policies: Any) -> QoSProfile:
    return QoSProfile(
        **{
            "history": HistoryPolicy.SYSTEM_DEFAULT,
            "depth": 0,
            "reliability": ReliabilityPolicy.SYSTEM_DEFAULT,
            "durability": DurabilityPolicy.SYSTEM_DEFAULT,
            **policies,
        }
    )


qos_profile_unknown = _system_default(
    history=HistoryPolicy.UNKNOWN,
    reliability=ReliabilityPolicy.UNKNOWN,
    durability=DurabilityPolicy.UNKNOWN,
    liveliness=LivelinessPolicy.UNKNOWN,
)
"""All policies are unknown; no endpoint can use it."""
qos_profile_default = QoSProfile(depth=_DEFAULT_DEPTH)
"""Keeps the last 10 messages; reliable."""
qos_profile_system_default = _system_default()
"""Leaves the policies to the middleware."""
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Keeps the last 5 messages; best effort."""
qos_profile_services_default = QoSProfile(depth=_DEFAULT_DEPTH)
"""The default of clients and services."""
qos_profile_parameters = QoSProfile(depth=1000)
"""The profile of the parameter services."""
qos_profile_parameter_events = QoSProfile(depth=1000)
"""The profile of `/parameter_events`."""
qos_profile_rosout_default = QoSProfile(
    depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10)
)
"""The profile of `/rosout`."""
qos_profile_best_available = QoSProfile(
    depth=_DEFAULT_DEPTH,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
    deadline=DeadlineBestAvailable,
    liveliness=LivelinessPolicy.BEST_AVAILABLE,
    liveliness_lease_duration=LivelinessLeaseDurationeBestAvailable,
)
"""Matches as many endpoints of the other side as possible."""
qos_profile_action_status_default = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""The profile of the status of actions."""


class QoSPresetProfiles(enum.Enum):
    """The profiles of this module by name."""

    UNKNOWN = qos_profile_unknown
    DEFAULT = qos_profile_default
    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ROSOUT_DEFAULT = qos_profile_rosout_default
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available

    @classmethod
    def short_keys(cls) -> list[str]:
        """The short names of all profiles."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """The profile of a short name, in lower or upper case; raises KeyError for another name."""
        return cls[name.upper()].value


class QoSCompatibility(enum.IntEnum):
    """Whether a publisher and a subscription are compatible."""

    OK = 0
    WARNING = 1
    ERROR = 2


def qos_check_compatible(
    publisher_qos: QoSProfile, subscription_qos: QoSProfile
) -> tuple[QoSCompatibility, str]:
    """Whether a publisher and a subscription are compatible, and the reasons if not."""
    if found := incompatibilities(publisher_qos, subscription_qos):
        return QoSCompatibility.ERROR, "".join(f"ERROR: {text};" for text in found)
    if found := possible_incompatibilities(publisher_qos, subscription_qos):
        return QoSCompatibility.WARNING, "".join(f"WARNING: {text};" for text in found)
    return QoSCompatibility.OK, ""
