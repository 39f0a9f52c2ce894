"""The events of publishers and subscriptions, and the objects that their callbacks receive."""

from __future__ import annotations

import dataclasses
import enum


class QoSPublisherEventType(enum.IntEnum):
    """The events of publishers."""

    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0
    RCL_PUBLISHER_LIVELINESS_LOST = 1
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3
    RCL_PUBLISHER_MATCHED = 4


class QoSSubscriptionEventType(enum.IntEnum):
    """The events of subscriptions."""

    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = 2
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4
    RCL_SUBSCRIPTION_MATCHED = 5


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSPublisherMatchedInfo:
    """How many subscriptions match a publisher, and the changes since the last event."""

    total_count: int = 0
    total_count_change: int = 0
    current_count: int = 0
    current_count_change: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSSubscriptionMatchedInfo(QoSPublisherMatchedInfo):
    """How many publishers match a subscription, and the changes since the last event."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSOfferedDeadlineMissedInfo:
    """How often a publisher missed the deadline that it offers."""

    total_count: int = 0
    total_count_change: int = 0


class QoSRequestedDeadlineMissedInfo(QoSOfferedDeadlineMissedInfo):
    """How often a publisher missed the deadline that a subscription requests."""


class QoSLivelinessLostInfo(QoSOfferedDeadlineMissedInfo):
    """How often a publisher did not declare in time that it is alive."""


class QoSMessageLostInfo(QoSOfferedDeadlineMissedInfo):
    """How many messages a subscription lost."""


class IncompatibleTypeInfo(QoSOfferedDeadlineMissedInfo):
    """How often an endpoint with another type was found on the topic."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSLivelinessChangedInfo:
    """How many publishers are alive, and how many are not."""

    alive_count: int = 0
    alive_count_change: int = 0
    not_alive_count: int = 0
    not_alive_count_change: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class QoSOfferedIncompatibleQoSInfo:
    """How often a publisher found a subscription that requests more than the publisher offers."""

    total_count: int = 0
    total_count_change: int = 0
    last_policy_kind: int = 0


class QoSRequestedIncompatibleQoSInfo(QoSOfferedIncompatibleQoSInfo):
    """How often a subscription found a publisher that offers less than it requests."""
