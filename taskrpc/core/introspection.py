"""Service introspection: publishes each step of a service's calls on `SERVICE/_service_event`.

The events are those of ROS 2: `taskrpc service echo` prints them for programs of both kinds.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

from taskrpc.core.callinfo import CallInfo
from taskrpc.core.observer import Observer, Observers
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.time_of_day import time_of_day_ns
from taskrpc.errors import InvalidRequest, TaskRpcError

if TYPE_CHECKING:
    from taskrpc.qos import QoS
    from taskrpc.service import Service
    from taskrpc.topic import Publisher

log = logging.getLogger("taskrpc.topics")

IntrospectionState: TypeAlias = Literal["off", "metadata", "contents"]
"""What is published: nothing, only that a step happened, or also the messages."""

SUFFIX = "/_service_event"


class PublishingNode(Protocol):
    """The part of a node that introspection needs."""

    def create_publisher(
        self, msg_type: type[Any], topic: str, qos: QoS | int = 10, *, role: Role = Role.OBSERVE
    ) -> Publisher[Any]:
        """Publish messages of a type on a topic."""


class ServiceIntrospection:
    """The introspected services of one node.

    `observer` is the node's own: its services report to both.
    """

    def __init__(self, node: PublishingNode, observer: Observer | None) -> None:
        self._node = node
        self._observer = observer
        self._publishers: dict[asyncio.Future[None], Publisher[Any]] = {}
        """Introspection publishers, keyed by `service.finished`."""

    def configure(self, service: Service, state: IntrospectionState, qos: QoS | int) -> None:
        """Start, change or end the introspection of a service."""
        if state not in ("off", "metadata", "contents"):
            raise ValueError(f"state: expected 'off', 'metadata' or 'contents', got {state!r}")
        self._stop(service.finished)
        if state == "off":
            service.observe(self._observer)
            return
        topic = f"{service.service_name}{SUFFIX}"
        srv_type: Any = service.srv_type
        publisher = self._node.create_publisher(srv_type.Event, topic, qos, role=Role.OPERATE)
        self._publishers[service.finished] = publisher
        events = ServiceEvents(publisher, srv_type, contents=state == "contents")
        service.observe(Observers(self._observer, events) if self._observer else events)
        service.finished.add_done_callback(self._stop)

    def _stop(self, finished: asyncio.Future[None]) -> None:
        finished.remove_done_callback(self._stop)
        if (publisher := self._publishers.pop(finished, None)) is not None:
            publisher.destroy()


class ServiceEvents(Observer):
    """Publishes the events of one service, if the topic has subscriptions."""

    def __init__(self, publisher: Publisher[Any], srv_type: Any, *, contents: bool) -> None:
        self.publisher = publisher
        self._srv_type = srv_type
        self._contents = contents
        self._has_failed = False

    def call_began(self, call: CallInfo) -> None:
        """Publish that a request arrived."""
        self._publish("REQUEST_RECEIVED", call, request=getattr(call, "request", None))

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """Publish that a response is sent."""
        self._publish("RESPONSE_SENT", call, response=response)

    def _publish(self, step: str, call: CallInfo, **messages: Any) -> None:
        if not self.publisher.get_subscription_count():
            return
        published = messages if self._contents else {}
        gid, stamp = gid_of(call.caller), time_of_day_ns()
        event = service_event(self._srv_type, step, stamp, gid, call.number, **published)
        try:
            self.publisher.publish(event)
        except InvalidRequest as error:  # the event is larger than its message, perhaps too large
            if not self._has_failed:
                self._has_failed = True
                log.warning("an event is missing on %s: %s", self.publisher.topic_name, error)
        except TaskRpcError:
            pass  # the publisher is destroyed, and this call ends later


def service_event(
    srv_type: Any,
    step: str,
    stamp: int,
    gid: list[int],
    number: int,
    request: Any = None,
    response: Any = None,
) -> Any:
    """Return the event of a step, by its name in ServiceEventInfo; `stamp` in ns since 1970."""
    event = srv_type.Event()
    info = event.info
    info.event_type = getattr(info, step)
    info.client_gid = gid
    info.sequence_number = number
    info.stamp.sec, info.stamp.nanosec = divmod(stamp, 10**9)
    event.request = [] if request is None else [request]
    event.response = [] if response is None else [response]
    return event


def gid_of(*parts: object) -> list[int]:
    """Return sixteen numbers that identify an endpoint."""
    return list(hashlib.sha256("\n".join(map(str, parts)).encode()).digest()[:16])
