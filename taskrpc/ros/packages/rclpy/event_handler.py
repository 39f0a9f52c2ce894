"""Events of topics: matches, missed deadlines, liveliness, and incompatible QoS or types.

taskrpc does not report lost messages. The callback of a program for this event never runs; a line
in the log of the program says this.
"""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ._impl.bridge import NativePublisher, NativeSubscription
from ._impl.execution.silence_watch import SilenceWatch
from ._impl.graph.event_infos import (
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
from ._impl.node_interface import NodeInterface
from .callback_groups import CallbackGroup
from .constants import S_TO_NS
from .exceptions import UnsupportedEventTypeError
from .qos import QoSPolicyKind
from .waitable import NumberOfEntities, Waitable

if TYPE_CHECKING:
    from taskrpc.qos import Timing

    from .handle import Handle

Callback = Callable[[Any], Any] | None
EventType = QoSPublisherEventType | QoSSubscriptionEventType


@dataclasses.dataclass(kw_only=True)
class SubscriptionEventCallbacks:
    """Callbacks for events of a subscription; by default, incompatible publishers are logged."""

    deadline: Callback = None
    incompatible_qos: Callback = None
    liveliness: Callback = None
    message_lost: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True

    def create_event_handlers(
        self, callback_group: CallbackGroup, subscription: Handle, topic_name: str
    ) -> list[EventHandler]:
        """Make a handler of each event that has a callback, given the subscription's `handle`.

        Add the handlers to the node as waitables. Raises InvalidHandle.
        """
        return _made(self, callback_group, subscription, topic_name, _SUBSCRIPTION_EVENTS)


@dataclasses.dataclass(kw_only=True)
class PublisherEventCallbacks:
    """Callbacks for events of a publisher; by default, incompatible subscriptions are logged."""

    deadline: Callback = None
    liveliness: Callback = None
    incompatible_qos: Callback = None
    incompatible_type: Callback = None
    matched: Callback = None
    use_default_callbacks: bool = True

    def create_event_handlers(
        self, callback_group: CallbackGroup, publisher: Handle, topic_name: str
    ) -> list[EventHandler]:
        """Make a handler of each event that has a callback, given the publisher's `handle`.

        Add the handlers to the node as waitables. Raises InvalidHandle.
        """
        return _made(self, callback_group, publisher, topic_name, _PUBLISHER_EVENTS)


EventCallbacks = SubscriptionEventCallbacks | PublisherEventCallbacks

_SUBSCRIPTION_EVENTS: dict[str, EventType] = {
    "deadline": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED,
    "incompatible_qos": QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
    "liveliness": QoSSubscriptionEventType.RCL_SUBSCRIPTION_LIVELINESS_CHANGED,
    "message_lost": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST,
    "incompatible_type": QoSSubscriptionEventType.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE,
    "matched": QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
}
"""The event of each callback, in the order in which ROS makes the handlers."""
_PUBLISHER_EVENTS: dict[str, EventType] = {
    "deadline": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED,
    "liveliness": QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST,
    "incompatible_qos": QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
    "incompatible_type": QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
    "matched": QoSPublisherEventType.RCL_PUBLISHER_MATCHED,
}


class EventHandler(Waitable[Any]):
    """Runs a callback, on the spinning thread, for each event of one kind.

    Args:
        parent_impl: the `handle` of the publisher or subscription that has the events.

    Raises:
        InvalidHandle: the publisher or subscription was destroyed.
        TypeError: it has no events of this type.
    """

    def __init__(
        self,
        *,
        callback_group: CallbackGroup,
        callback: Callable[[Any], Any],
        event_type: EventType,
        parent_impl: Handle,
    ) -> None:
        super().__init__(callback_group)
        self.callback = callback
        self.event_type = event_type
        self.total = 0
        self._events: deque[Any] = deque()
        with parent_impl:
            self._source: Events = parent_impl.owner._events
        self._source.add(self)

    def happened(self, event: Any) -> None:
        """Pass an event to the callback; from any thread."""
        self._events.append(event)
        self.notify_executor()

    def destroy(self) -> None:
        """Receive no more events."""
        self._source.remove(self)

    def get_num_entities(self) -> NumberOfEntities:
        """How many entities it waits for: one event."""
        return NumberOfEntities(num_events=1)

    def has_work(self) -> bool:
        """Whether an event waits for the callback."""
        return bool(self._events)

    def take_work(self) -> Callable[[], Any] | None:
        """Take the oldest event and return the call of the callback."""
        try:
            event = self._events.popleft()
        except IndexError:  # another thread took it
            return None
        return lambda: self.callback(event)


class _Logging(EventHandler):
    """A handler that logs at once, even if the node does not spin."""

    def happened(self, event: Any) -> None:
        """Log the event; from any thread."""
        self.callback(event)


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
    """The events of one publisher or subscription, which it passes to their handlers."""

    def __init__(
        self,
        node: NodeInterface,
        group: CallbackGroup,
        callbacks: EventCallbacks,
        topic: str,
        timing: Timing | None = None,
    ) -> None:
        self._node = node
        self._topic = topic
        self._callbacks = callbacks
        self._group = group
        subscribes = isinstance(callbacks, SubscriptionEventCallbacks)
        self._kinds = _SUBSCRIPTION_EVENTS if subscribes else _PUBLISHER_EVENTS
        self._qos_info: type[QoSOfferedIncompatibleQoSInfo] = (
            QoSRequestedIncompatibleQoSInfo if subscribes else QoSOfferedIncompatibleQoSInfo
        )
        self._deadline_info = (
            QoSRequestedDeadlineMissedInfo if subscribes else QoSOfferedDeadlineMissedInfo
        )
        self._matched_info = QoSSubscriptionMatchedInfo if subscribes else QoSPublisherMatchedInfo
        self._matches = 0
        """The last reported number of matching endpoints."""
        self._native: NativePublisher | NativeSubscription | None = None
        self._watches = False
        """Whether the native endpoint reports its matches."""
        self._liveliness = (0, 0)
        """The last reported numbers of publishers that are alive, and that are not."""
        self._has_lease = timing is not None and timing.lease > 0
        self._deadline, self._lease = self._silence_watches(timing, publishes=not subscribes)
        self._handlers: tuple[EventHandler, ...] = ()
        """Replaced as a whole: the loop's thread reads it while programs add handlers."""
        self._own: list[EventHandler] = []
        """The handlers of `event_callbacks`; `destroy` destroys only these."""
        if getattr(callbacks, "message_lost", None) is not None:
            node.get_logger().warning(f"taskrpc does not report the event message_lost of {topic}")

    def _silence_watches(
        self, timing: Timing | None, *, publishes: bool
    ) -> tuple[SilenceWatch | None, SilenceWatch | None]:
        """The watches of the deadline, and of the lease that a program must renew."""
        deadline = lease = None
        if timing is not None and timing.deadline:
            loop = self._node.handle.bridge.event_loop
            period, silent = timing.deadline / S_TO_NS, self._deadline_missed
            deadline = SilenceWatch(loop, period, silent, repeats=True)
        if timing is not None and publishes and timing.is_manual and timing.lease:
            loop = self._node.handle.bridge.event_loop
            period, silent = timing.lease / S_TO_NS, self._liveliness_lost
            lease = SilenceWatch(loop, period, silent, repeats=False, resumed=self._is_alive)
        return deadline, lease

    @property
    def are_timed(self) -> bool:
        """Whether they depend on when `exchanged` or `asserted` is called."""
        return self._deadline is not None or self._lease is not None

    def exchanged(self) -> None:
        """Note that a message was published or received; from any thread."""
        if self._deadline is not None:
            self._deadline.happened()
        self.asserted()

    def asserted(self) -> None:
        """Note that the program has declared its publisher alive; from any thread."""
        if self._lease is not None:
            self._lease.happened()

    def create_handlers(self, parent: Handle) -> list[EventHandler]:
        """Create the handlers of the callbacks and add them to the node."""
        self._own = self._callbacks.create_event_handlers(self._group, parent, self._topic)
        for handler in self._own:
            if not isinstance(handler, _Logging):
                self._node.add_waitable(handler)
        return self._own

    def add(self, handler: EventHandler) -> None:
        """Report events of its type to a handler. Raises TypeError for a type of the other kind."""
        expected = type(self._kinds["matched"])
        if not isinstance(handler.event_type, expected):  # the numbers of both kinds are equal
            got = repr(handler.event_type)
            raise TypeError(f"expected event_type to be a {expected.__name__}, got {got}")
        self._handlers += (handler,)
        self._watch()

    def remove(self, handler: EventHandler) -> None:
        """Report no more events to a handler."""
        self._handlers = tuple(each for each in self._handlers if each is not handler)

    def mismatch(self, what: str) -> None:
        """Report an incompatible endpoint; called on the thread of the event loop."""
        for handler in self._of("incompatible_type" if what == "TYPE" else "incompatible_qos"):
            handler.total += 1
            if what == "TYPE":
                event: Any = IncompatibleTypeInfo(total_count=handler.total, total_count_change=1)
            else:
                event = self._qos_info(
                    total_count=handler.total,
                    total_count_change=1,
                    last_policy_kind=QoSPolicyKind[what],
                )
            handler.happened(event)

    def watch(self, native: NativePublisher | NativeSubscription) -> None:
        """Report matches as soon as a handler needs them."""
        self._native = native
        self._watch()

    def _watch(self) -> None:
        native, needed = self._native, self._of("matched")
        if self._has_lease:
            needed += self._of("liveliness")
        if native is not None and not self._watches and needed:
            self._watches = True
            native.watch_matches(self._matches_are)

    def _of(self, name: str) -> list[EventHandler]:
        return [each for each in self._handlers if each.event_type is self._kinds[name]]

    def _matches_are(self, count: int) -> None:
        """Report the number of matching endpoints; called on the thread of the event loop."""
        if self._has_lease and isinstance(self._native, NativeSubscription):
            self._liveliness_is(*self._native.get_liveliness())
        change, self._matches = count - self._matches, count
        if not change:
            return
        more = max(0, change)
        for handler in self._of("matched"):
            handler.total += more
            event = self._matched_info(
                total_count=handler.total,
                total_count_change=more,
                current_count=count,
                current_count_change=change,
            )
            handler.happened(event)

    # Called on the thread of the event loop

    def _liveliness_is(self, alive: int, silent: int) -> None:
        was_alive, was_silent = self._liveliness
        if (alive, silent) == self._liveliness:
            return
        self._liveliness = alive, silent
        event = QoSLivelinessChangedInfo(
            alive_count=alive,
            alive_count_change=alive - was_alive,
            not_alive_count=silent,
            not_alive_count_change=silent - was_silent,
        )
        for handler in self._of("liveliness"):
            handler.happened(event)

    def _is_alive(self) -> None:
        if isinstance(self._native, NativePublisher):
            self._native.set_alive(True)

    def _liveliness_lost(self) -> None:
        if isinstance(self._native, NativePublisher):
            self._native.set_alive(False)
        self._count("liveliness", QoSLivelinessLostInfo)

    def _deadline_missed(self) -> None:
        self._count("deadline", self._deadline_info)

    def _count(self, name: str, info: type[QoSOfferedDeadlineMissedInfo]) -> None:
        for handler in self._of(name):
            handler.total += 1
            handler.happened(info(total_count=handler.total, total_count_change=1))

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Destroy the events again if their publisher or subscription cannot be created."""
        try:
            yield
        except BaseException:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Destroy the handlers of `event_callbacks`, and stop watching."""
        for watch in (self._deadline, self._lease):
            if watch is not None:
                watch.close()
        for handler in self._own:
            handler.destroy()
            if not isinstance(handler, _Logging):
                self._node.remove_waitable(handler)


def _made(
    callbacks: EventCallbacks,
    group: CallbackGroup,
    parent: Handle,
    topic: str,
    kinds: dict[str, EventType],
) -> list[EventHandler]:
    parent.check()
    subscribes = isinstance(callbacks, SubscriptionEventCallbacks)
    log = _Log(parent.owner.parent_node.get_logger(), topic, subscribes)
    handlers: list[EventHandler] = []
    for name, kind in kinds.items():
        callback, handler = getattr(callbacks, name), EventHandler
        if callback is None and callbacks.use_default_callbacks and name.startswith("incompatible"):
            callback, handler = log, _Logging
        if callback is not None:
            handlers.append(
                handler(
                    callback_group=group, callback=callback, event_type=kind, parent_impl=parent
                )
            )
    return handlers


class _Log:
    """The default callback: logs a warning about an incompatible endpoint."""

    def __init__(self, logger: Any, topic: str, subscribes: bool) -> None:
        self._logger = logger
        self._topic = topic
        self._other = "publisher" if subscribes else "subscription"
        self._verbs = ("offering", "received from") if subscribes else ("requesting", "sent to")

    def __call__(self, event: Any) -> None:
        offering, received = self._verbs
        kind = getattr(event, "last_policy_kind", None)
        problem = "type" if kind is None else "QoS"
        policy = "" if kind is None else f" Last incompatible policy: {kind.name}"
        self._logger.warning(
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
