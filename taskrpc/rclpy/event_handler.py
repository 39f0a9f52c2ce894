"""Events of publishers and subscriptions: matches, and incompatible QoS or types.

Deadlines, leases and losses are not watched by this layer; a program that asks for them
runs as on a network where nothing of the kind happens, and is told so once in its log.
"""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ._event_infos import (
    IncompatibleTypeInfo,
    QoSLivelinessChangedInfo,
    QoSLivelinessLostInfo,
    QoSMessageLostInfo,
    QoSOfferedDeadlineMissedInfo,
    QoSOfferedIncompatibleQoSInfo,
    QoSPublisherEventType,
    QoSPublisherMatchedInfo,
    QoSRequestedDeadlineMissedInfo,
    QoSRequestedIncompatibleQoSInfo,
    QoSSubscriptionEventType,
    QoSSubscriptionMatchedInfo,
)
from .callback_groups import CallbackGroup
from .exceptions import UnsupportedEventTypeError
from .qos import QoSPolicyKind
from .waitable import Waitable

if TYPE_CHECKING:
    from ._bridge import NativePublisher, NativeSubscription
    from .node import Node

Callback = Callable[[Any], Any] | None
EventType = QoSPublisherEventType | QoSSubscriptionEventType

_REPORTED = ("incompatible_qos", "incompatible_type", "matched")


@dataclasses.dataclass(kw_only=True)
class SubscriptionEventCallbacks:
    """Callbacks for events of a subscription; without any, what does not fit is logged."""

    deadline: Callback = None
    incompatible_qos: Callback = None
    liveliness: Callback = None
    message_lost: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True


@dataclasses.dataclass(kw_only=True)
class PublisherEventCallbacks:
    """Callbacks for events of a publisher; without any, what does not fit is logged."""

    deadline: Callback = None
    liveliness: Callback = None
    incompatible_qos: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True


class EventHandler(Waitable[Any]):
    """Runs a callback, on the spinning thread, for each event of one kind."""

    def __init__(
        self,
        *,
        callback_group: CallbackGroup,
        callback: Callable[[Any], Any],
        event_type: EventType,
        parent_impl: Any = None,
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self.event_type = event_type
        self.total = 0
        self._events: deque[Any] = deque()

    def happened(self, event: Any) -> None:
        """Have the callback called with this; from any thread."""
        self._events.append(event)
        self._arrived()

    def _ready(self) -> bool:
        return bool(self._events)

    def _take(self) -> Callable[[], Any] | None:
        try:
            event = self._events.popleft()
        except IndexError:  # another thread was quicker
            return None
        return lambda: self.callback(event)


class QoSEventHandler(EventHandler):
    """The old name of `EventHandler`."""

    def __init__(self, *args: Any, **options: Any) -> None:
        warnings.warn(
            "QoSEventHandler is deprecated, use EventHandler instead.",
            DeprecationWarning,
            stacklevel=2,
        )
        super().__init__(*args, **options)


class Events:
    """The handlers of one publisher or subscription."""

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        callbacks: SubscriptionEventCallbacks | PublisherEventCallbacks,
        topic: str,
    ) -> None:
        self._node = node
        self._topic = topic
        subscribes = isinstance(callbacks, SubscriptionEventCallbacks)
        self._other = "publisher" if subscribes else "subscription"
        self._verbs = ("offering", "received from") if subscribes else ("requesting", "sent to")
        self._qos_info: type[QoSOfferedIncompatibleQoSInfo] = (
            QoSRequestedIncompatibleQoSInfo if subscribes else QoSOfferedIncompatibleQoSInfo
        )
        self.handlers: list[EventHandler] = []
        kinds = QoSSubscriptionEventType if subscribes else QoSPublisherEventType
        of_type = {kind.name.rpartition("INCOMPATIBLE_")[2]: kind for kind in kinds}
        matched = kinds["RCL_SUBSCRIPTION_MATCHED" if subscribes else "RCL_PUBLISHER_MATCHED"]
        self._defaults: list[EventHandler] = []
        """The handlers that log incompatible QoS and types, even if the node does not spin."""
        self._matched_info = QoSSubscriptionMatchedInfo if subscribes else QoSPublisherMatchedInfo
        self._matches = 0
        logs = callbacks.use_default_callbacks
        self._qos = self._handler(group, callbacks.incompatible_qos, of_type["QOS"], logs)
        self._type = self._handler(group, callbacks.incompatible_type, of_type["TYPE"], logs)
        self._matched = self._handler(group, callbacks.matched, matched)
        asked = [one.name for one in dataclasses.fields(callbacks) if one.name not in _REPORTED]
        if missing := [name for name in asked if callable(getattr(callbacks, name))]:
            node.get_logger().warning(
                f"taskrpc does not report these events of {topic}: {', '.join(missing)}"
            )

    def mismatch(self, what: str) -> None:
        """An incompatible endpoint was found; called on the loop's thread."""
        handler = self._type if what == "TYPE" else self._qos
        if handler is None:
            return
        handler.total += 1
        if what == "TYPE":
            event: Any = IncompatibleTypeInfo(total_count=handler.total, total_count_change=1)
        else:
            event = self._qos_info(
                total_count=handler.total,
                total_count_change=1,
                last_policy_kind=QoSPolicyKind[what],
            )
        if handler in self._defaults:
            handler.callback(event)
        else:
            handler.happened(event)

    def watch(self, native: NativePublisher | NativeSubscription) -> None:
        """Report matches if a callback for them is given."""
        if self._matched is not None:
            native.watch_matches(self._matches_are)

    def _matches_are(self, count: int) -> None:
        """So many of the others match; called on the loop's thread."""
        change, self._matches = count - self._matches, count
        if self._matched is None or not change:
            return
        more = max(0, change)
        self._matched.total += more
        event = self._matched_info(
            total_count=self._matched.total,
            total_count_change=more,
            current_count=count,
            current_count_change=change,
        )
        self._matched.happened(event)

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Have them only if what they belong to can be made."""
        try:
            yield
        except BaseException:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Call no more."""
        for handler in self.handlers:
            if handler in self._defaults:
                continue
            self._node.remove_waitable(handler)

    def _handler(
        self, group: CallbackGroup, callback: Callback, event_type: EventType, logs: bool = False
    ) -> EventHandler | None:
        if callback is None and not logs:
            return None
        handler = EventHandler(
            callback_group=group, callback=callback or self._log, event_type=event_type
        )
        self.handlers.append(handler)
        if callback is None:
            self._defaults.append(handler)
        else:
            self._node.add_waitable(handler)
        return handler

    def _log(self, event: Any) -> None:
        offering, received = self._verbs
        kind = getattr(event, "last_policy_kind", None)
        problem = "type" if kind is None else "QoS"
        policy = "" if kind is None else f" Last incompatible policy: {kind.name}"
        self._node.get_logger().warning(
            f"New {self._other} discovered on topic '{self._topic}', {offering} incompatible"
            f" {problem}. No messages will be {received} it.{policy}"
        )


__all__ = [
    "EventHandler",
    "Events",
    "IncompatibleTypeInfo",
    "PublisherEventCallbacks",
    "QoSEventHandler",
    "QoSLivelinessChangedInfo",
    "QoSLivelinessLostInfo",
    "QoSMessageLostInfo",
    "QoSOfferedDeadlineMissedInfo",
    "QoSOfferedIncompatibleQoSInfo",
    "QoSPublisherEventType",
    "QoSPublisherMatchedInfo",
    "QoSRequestedDeadlineMissedInfo",
    "QoSRequestedIncompatibleQoSInfo",
    "QoSSubscriptionEventType",
    "QoSSubscriptionMatchedInfo",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
]
