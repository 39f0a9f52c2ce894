"""What programs want to know of the quality of a topic's service; taken, and never reported here.

Deadlines, leases and matches are not watched by this layer; a program that asks for them runs as
on a network where nothing of the kind happens, and is told so once in its log.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from .exceptions import UnsupportedEventTypeError

Callback = Callable[[Any], Any] | None


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


@dataclasses.dataclass(kw_only=True)
class SubscriptionEventCallbacks:
    """Callbacks for events of a subscription."""

    deadline: Callback = None
    incompatible_qos: Callback = None
    liveliness: Callback = None
    message_lost: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True


@dataclasses.dataclass(kw_only=True)
class PublisherEventCallbacks:
    """Callbacks for events of a publisher."""

    deadline: Callback = None
    liveliness: Callback = None
    incompatible_qos: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True


def wanted(callbacks: SubscriptionEventCallbacks | PublisherEventCallbacks | None) -> list[str]:
    """The names of the events that a program asks for."""
    if callbacks is None:
        return []
    asked = dataclasses.asdict(callbacks)
    return [name for name, callback in asked.items() if callable(callback)]


__all__ = [
    "IncompatibleTypeInfo",
    "PublisherEventCallbacks",
    "QoSDeadlineOfferedInfo",
    "QoSDeadlineRequestedInfo",
    "QoSLivelinessChangedInfo",
    "QoSLivelinessLostInfo",
    "QoSMessageLostInfo",
    "QoSOfferedIncompatibleQoSInfo",
    "QoSPublisherMatchedInfo",
    "QoSRequestedIncompatibleQoSInfo",
    "QoSSubscriptionMatchedInfo",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
    "wanted",
]
