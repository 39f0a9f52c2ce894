"""What callbacks for events of topics are told."""

from __future__ import annotations

import dataclasses


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
class QoSDeadlineOfferedInfo:
    """How often a publisher was later than it promised."""

    total_count: int = 0
    total_count_change: int = 0


class QoSDeadlineRequestedInfo(QoSDeadlineOfferedInfo):
    """How often a message came later than a subscription wants."""


class QoSLivelinessLostInfo(QoSDeadlineOfferedInfo):
    """How often a publisher did not say in time that it lives."""


class QoSMessageLostInfo(QoSDeadlineOfferedInfo):
    """How many messages a subscription lost."""


class IncompatibleTypeInfo(QoSDeadlineOfferedInfo):
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
