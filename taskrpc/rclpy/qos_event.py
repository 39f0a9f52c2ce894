"""The name by which older programs know `event_handler`."""

from .event_handler import (
    EventHandler,
    IncompatibleTypeInfo,
    PublisherEventCallbacks,
    QoSDeadlineOfferedInfo,
    QoSDeadlineRequestedInfo,
    QoSLivelinessChangedInfo,
    QoSLivelinessLostInfo,
    QoSMessageLostInfo,
    QoSOfferedIncompatibleQoSInfo,
    QoSPublisherMatchedInfo,
    QoSRequestedIncompatibleQoSInfo,
    QoSSubscriptionMatchedInfo,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)

QoSEventHandler = EventHandler
QoSOfferedDeadlineMissedInfo = QoSDeadlineOfferedInfo
QoSRequestedDeadlineMissedInfo = QoSDeadlineRequestedInfo

__all__ = [
    "IncompatibleTypeInfo",
    "PublisherEventCallbacks",
    "QoSDeadlineOfferedInfo",
    "QoSDeadlineRequestedInfo",
    "QoSEventHandler",
    "QoSLivelinessChangedInfo",
    "QoSLivelinessLostInfo",
    "QoSMessageLostInfo",
    "QoSOfferedDeadlineMissedInfo",
    "QoSOfferedIncompatibleQoSInfo",
    "QoSPublisherMatchedInfo",
    "QoSRequestedDeadlineMissedInfo",
    "QoSRequestedIncompatibleQoSInfo",
    "QoSSubscriptionMatchedInfo",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
]
