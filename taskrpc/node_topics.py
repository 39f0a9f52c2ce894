"""What a node has beside services and clients: publishers, subscriptions, timers."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc import names
from taskrpc.message_types import MsgT, message_type
from taskrpc.qos import QoS, qos_of
from taskrpc.security.roles import Role
from taskrpc.transport.base import OnMismatch, Transport

if TYPE_CHECKING:
    import asyncio

    from taskrpc.introspection import IntrospectionState
    from taskrpc.observer import Observer, TopicStatus
    from taskrpc.service import Service
    from taskrpc.timer import Timer
    from taskrpc.topic import Publisher, Subscription


class _Part(Protocol):
    def destroy(self) -> None: ...
    def _count_into(self, topics: dict[str, TopicStatus]) -> None: ...


class NodeTopics:
    """The part of a node that publishes, subscribes and keeps time."""

    _name: str
    _namespace: str
    _observer: Observer | None

    def __init__(self) -> None:
        self._parts: dict[_Part, None] = {}
        self._topics_before: dict[str, TopicStatus] = {}
        """What those have done that are gone."""
        self._events: dict[asyncio.Future[None], Publisher[Any]] = {}
        """What tells of a service's calls, by that which is done at the service's end."""

    @abstractmethod
    def get_fully_qualified_name(self) -> str:
        """`/namespace/name`."""

    @abstractmethod
    def _started(self) -> Transport: ...

    @abstractmethod
    def _name_in_lab(self, name: str) -> str: ...

    def resolve_topic_name(self, topic: str) -> str:
        """The absolute name that a topic name means for this node."""
        return names.expand(topic, namespace=self._namespace, node=self._name, kind="topic name")

    def create_publisher(
        self,
        msg_type: type[MsgT],
        topic: str,
        qos: QoS | int = 10,
        *,
        role: Role = Role.OBSERVE,
        on_mismatch: OnMismatch | None = None,
    ) -> Publisher[MsgT]:
        """Publish messages of a type on a topic; a number as `qos` is the depth.

        `role` is the least that a subscriber's account must have, where the node has accounts.
        A subscription that does not match is told in a warning, or to `on_mismatch(what)`: `TYPE`,
        `RELIABILITY` or `DURABILITY`, on the event loop.

        Raises InvalidName, CannotListen.
        """
        from taskrpc.topic import Publisher  # few programs publish

        publisher = Publisher(
            self._started(),
            message_type(msg_type),
            self.resolve_topic_name(topic),
            self.get_fully_qualified_name(),
            qos_of(qos),
            role,
            self._forget_part,
            on_mismatch,
        )
        self._parts[publisher] = None
        return publisher

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: Callable[[MsgT], object],
        qos: QoS | int = 10,
        *,
        threaded: bool = False,
        on_mismatch: OnMismatch | None = None,
    ) -> Subscription[MsgT]:
        """Call `callback(message)` for each message of a topic; a number as `qos` is the depth.

        The callback may be async. A plain one runs on the event loop and must be quick;
        `threaded=True` runs it in a thread instead. One call at a time; while it runs, the last
        `depth` messages wait. Publishers of the topic are found whenever they come; of one that
        does not match, `on_mismatch` is told as in `create_publisher`.

        Raises InvalidName.
        """
        from taskrpc.topic import Subscription  # few programs subscribe

        subscription = Subscription(
            self._started(),
            message_type(msg_type),
            self.resolve_topic_name(topic),
            self.get_fully_qualified_name(),
            callback,
            qos_of(qos),
            threaded=threaded,
            forget=self._forget_part,
            on_mismatch=on_mismatch,
            otherwise=self._name_in_lab(topic),
        )
        self._parts[subscription] = None
        return subscription

    def create_timer(
        self, period: float, callback: Callable[[], object], *, threaded: bool = False
    ) -> Timer:
        """Call `callback()` every `period` seconds, first after one period.

        The callback may be async; a plain one runs on the event loop unless `threaded=True`. What
        would be due while a call runs is left out.
        """
        from taskrpc.timer import Timer  # few programs have one

        self._started()
        timer = Timer(period, callback, threaded=threaded, forget=self._forget_part)
        self._parts[timer] = None
        return timer

    def configure_introspection(
        self, service: Service, state: IntrospectionState, qos: QoS | int = 100
    ) -> None:
        """Tell each call of this node's service on the topic `SERVICE/_service_event`.

        With `metadata` that a request came and its response went, when, and whose it was; with
        `contents` the messages, too; no longer with `off`. `taskrpc service echo` shows it. Where
        the node has accounts, subscribers need the role operate. A service that tells nothing pays
        nothing for this.

        Raises CannotListen.
        """
        from taskrpc.introspection import SUFFIX, ServiceEvents  # few services tell of themselves
        from taskrpc.observer import Observers

        if state not in ("off", "metadata", "contents"):
            raise ValueError(f"state: expected 'off', 'metadata' or 'contents', got {state!r}")
        self._stop_events(service.finished)
        if state == "off":
            service.observe(self._observer)
            return
        topic, role = f"{service.service_name}{SUFFIX}", Role.OPERATE
        srv_type: Any = service.srv_type
        publisher = self.create_publisher(srv_type.Event, topic, qos, role=role)
        self._events[service.finished] = publisher
        events = ServiceEvents(publisher, srv_type, contents=state == "contents")
        service.observe(Observers(self._observer, events) if self._observer else events)
        service.finished.add_done_callback(self._stop_events)

    def _stop_events(self, finished: asyncio.Future[None]) -> None:
        finished.remove_done_callback(self._stop_events)
        if (publisher := self._events.pop(finished, None)) is not None:
            publisher.destroy()

    def _destroy_parts(self) -> None:
        for part in list(self._parts):
            part.destroy()

    def _forget_part(self, part: _Part) -> None:
        if part in self._parts:
            del self._parts[part]
            part._count_into(self._topics_before)
            for status in self._topics_before.values():
                status.subscriptions = status.publishers = 0

    def _topic_status(self) -> dict[str, TopicStatus]:
        topics = {name: copy(status) for name, status in self._topics_before.items()}
        for part in list(self._parts):  # another thread may ask
            part._count_into(topics)
        return topics
