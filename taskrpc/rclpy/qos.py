"""Quality of service: what a publisher offers, what a subscription asks for, by ROS's names."""

from __future__ import annotations

import enum
import warnings
from typing import Any, Self, TypeVar

from taskrpc.qos import MAX_DEPTH, QoS

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
_DEFAULT_DEPTH = 10
_ALL = 5000  # a reader that never catches up must not take all memory; DDS has such a limit, too


class InvalidQoSProfileException(Exception):
    """A profile lacks a history or depth."""

    def __init__(self, *args: Any) -> None:
        super().__init__("Invalid QoSProfile", *args)


class QoSProfile:
    """The policies of a publisher, a subscription, a client or a service.

    Give a depth (the last so many messages are kept), or `history=HistoryPolicy.KEEP_ALL`; what
    is not given is as in `qos_profile_default`. Here depth, history, reliability and durability
    have effects; the others are kept and compared.

    Raises InvalidQoSProfileException without both, AssertionError for what is no policy.
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
        """Whether the last `depth` messages are kept, or all."""
        return self._history

    @history.setter
    def history(self, value: HistoryPolicy | int) -> None:
        self._history = HistoryPolicy(_checked(value, int))

    @property
    def depth(self) -> int:
        """How many messages are kept for who is behind."""
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
        """Whether every message arrives, or only what can be had without waiting."""
        return self._reliability

    @reliability.setter
    def reliability(self, value: ReliabilityPolicy | int) -> None:
        self._reliability = ReliabilityPolicy(_checked(value, int))

    @property
    def durability(self) -> DurabilityPolicy:
        """Whether those who come later are given the last messages."""
        return self._durability

    @durability.setter
    def durability(self, value: DurabilityPolicy | int) -> None:
        self._durability = DurabilityPolicy(_checked(value, int))

    @property
    def lifespan(self) -> Duration:
        """How long a message is worth being delivered; zero: always."""
        return self._lifespan

    @lifespan.setter
    def lifespan(self, value: Duration) -> None:
        self._lifespan = _checked(value, Duration)

    @property
    def deadline(self) -> Duration:
        """How long the next message may take; zero: as long as it likes."""
        return self._deadline

    @deadline.setter
    def deadline(self, value: Duration) -> None:
        self._deadline = _checked(value, Duration)

    @property
    def liveliness(self) -> LivelinessPolicy:
        """Who says that a publisher is alive."""
        return self._liveliness

    @liveliness.setter
    def liveliness(self, value: LivelinessPolicy | int) -> None:
        self._liveliness = LivelinessPolicy(_checked(value, int))

    @property
    def liveliness_lease_duration(self) -> Duration:
        """How often a publisher must say so; zero: never."""
        return self._liveliness_lease_duration

    @liveliness_lease_duration.setter
    def liveliness_lease_duration(self, value: Duration) -> None:
        self._liveliness_lease_duration = _checked(value, Duration)

    @property
    def avoid_ros_namespace_conventions(self) -> bool:
        """Whether the topic's name is taken as it is."""
        return self._avoid_ros_namespace_conventions

    @avoid_ros_namespace_conventions.setter
    def avoid_ros_namespace_conventions(self, value: bool) -> None:
        self._avoid_ros_namespace_conventions = _checked(value, bool)

    def get_c_qos_profile(self) -> Self:
        """The profile as others hand it on: `to_dict()` has its policies."""
        return self

    def to_dict(self) -> dict[str, Any]:
        """The policies by name: what `QoSProfile(**policies)` makes the same profile of."""
        return {name: getattr(self, name) for name in _POLICIES}

    def to_native(self, *, subscribes: bool = False) -> QoS:
        """What taskrpc's own publishers and subscriptions take."""
        keeps_all = self.history == HistoryPolicy.KEEP_ALL
        reliable = self.reliability not in _unreliable(subscribes)
        latched = self.durability == DurabilityPolicy.TRANSIENT_LOCAL or (
            self.durability == DurabilityPolicy.BEST_AVAILABLE and not subscribes
        )
        return QoS(
            depth=_ALL if keeps_all else min(self.depth or _DEFAULT_DEPTH, MAX_DEPTH - 1),
            reliability="reliable" if reliable else "best_effort",
            durability="transient_local" if latched else "volatile",
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        policies = ", ".join(f"{name}={value!s}" for name, value in self.to_dict().items())
        return f"{type(self).__name__}({policies})"

    __repr__ = __str__


def _checked(value: object, kind: type[_T]) -> _T:
    """The value, unless it is of another type: an AssertionError, as in rclpy."""
    if not isinstance(value, kind):
        raise AssertionError(f"expected {kind.__name__}, got {value!r}")
    return value


def _unreliable(subscribes: bool) -> tuple[ReliabilityPolicy, ...]:
    """The reliabilities under which messages may be left out; best available fits everybody."""
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
"""What is not known; no profile to work with."""
qos_profile_default = QoSProfile(depth=_DEFAULT_DEPTH)
"""The last 10 messages, reliably."""
qos_profile_system_default = _system_default()
"""Whatever carries the messages decides."""
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
"""The last 5 messages, rather new ones than all."""
qos_profile_services_default = QoSProfile(depth=_DEFAULT_DEPTH)
"""Of clients and services."""
qos_profile_parameters = QoSProfile(depth=1000)
"""Of the services for parameters."""
qos_profile_parameter_events = QoSProfile(depth=1000)
"""Of /parameter_events."""
qos_profile_rosout_default = QoSProfile(
    depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10)
)
"""Of /rosout."""
qos_profile_best_available = QoSProfile(
    depth=_DEFAULT_DEPTH,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
    deadline=DeadlineBestAvailable,
    liveliness=LivelinessPolicy.BEST_AVAILABLE,
    liveliness_lease_duration=LivelinessLeaseDurationeBestAvailable,
)
"""As much as the other side has."""
qos_profile_action_status_default = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of the status of actions."""


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
        """The names as a person types them."""
        return [name.lower() for name in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """The profile of a name, in any case of letters. Raises KeyError."""
        return cls[name.upper()].value


class QoSCompatibility(enum.IntEnum):
    """Whether a subscription gets what a publisher offers."""

    OK = 0
    WARNING = 1
    ERROR = 2


def qos_check_compatible(
    publisher_qos: QoSProfile, subscription_qos: QoSProfile
) -> tuple[QoSCompatibility, str]:
    """Whether a publisher and a subscription would find each other, and why not."""
    if found := incompatibilities(publisher_qos, subscription_qos):
        return QoSCompatibility.ERROR, "".join(f"ERROR: {text};" for text in found)
    if found := possible_incompatibilities(publisher_qos, subscription_qos):
        return QoSCompatibility.WARNING, "".join(f"WARNING: {text};" for text in found)
    return QoSCompatibility.OK, ""
