"""What callbacks for events of topics are told."""

from __future__ import annotations

import dataclasses
import enum


class QoSPublisherEventType(enum.IntEnum):
    """What can happen to a publisher."""

    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0
    RCL_PUBLISHER_LIVELINESS_LOST = 1
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3
    RCL_PUBLISHER_MATCHED = 4


class QoSSubscriptionEventType(enum.IntEnum):
    """What can happen to a subscription."""

    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = 2
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4
    RCL_SUBSCRIPTION_MATCHED = 5


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSPublisherMatchedInfo:
    """How many subscriptions fit a publisher, and how many more than at the last event."""

    total_count: int = 0
    total_count_change: int = 0
    current_count: int = 0
    current_count_change: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSSubscriptionMatchedInfo(QoSPublisherMatchedInfo):
    """How many publishers fit a subscription, and how many more than at the last event."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSOfferedDeadlineMissedInfo:
    """How often a publisher was later than it promised."""

    total_count: int = 0
    total_count_change: int = 0


class QoSRequestedDeadlineMissedInfo(QoSOfferedDeadlineMissedInfo):
    """How often a message came later than a subscription wants."""


class QoSLivelinessLostInfo(QoSOfferedDeadlineMissedInfo):
    """How often a publisher did not say in time that it lives."""


class QoSMessageLostInfo(QoSOfferedDeadlineMissedInfo):
    """How many messages a subscription lost."""


class IncompatibleTypeInfo(QoSOfferedDeadlineMissedInfo):
    """How often another type was met on the topic."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSLivelinessChangedInfo:
    """How many publishers live, and how many do not."""

    alive_count: int = 0
    alive_count_change: int = 0
    not_alive_count: int = 0
    not_alive_count_change: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSOfferedIncompatibleQoSInfo:
    """How often a publisher met a subscription that wants more than it offers."""

    total_count: int = 0
    total_count_change: int = 0
    last_policy_kind: int = 0


class QoSRequestedIncompatibleQoSInfo(QoSOfferedIncompatibleQoSInfo):
    """How often a subscription met a publisher that offers less than it wants."""
