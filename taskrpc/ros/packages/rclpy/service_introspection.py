"""Service introspection: each step of a call is published on `SERVICE/_service_event`."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

from taskrpc.spi import SUFFIX, service_event

from ._impl.node_interface import NodeInterface
from .qos import QoSProfile

if TYPE_CHECKING:
    from .clock import Clock


class ServiceIntrospectionState(IntEnum):
    """How much is published: nothing, the events, or the events with their messages."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class Introspection:
    """Publishes the introspection events of one client or service; nothing before `configure`."""

    def __init__(self, node: NodeInterface, srv_type: Any, service: str) -> None:
        self._node = node
        self._srv_type = srv_type
        self._topic = f"{service}{SUFFIX}"
        self._state = ServiceIntrospectionState.OFF
        self._publisher: Any = None
        self._clock: Clock | None = None

    @property
    def is_on(self) -> bool:
        """Whether events are published."""
        return self._state is not ServiceIntrospectionState.OFF

    def configure(
        self, clock: Clock, qos_profile: QoSProfile, state: ServiceIntrospectionState
    ) -> None:
        """Publish with this content from now on, with the time of this clock."""
        self.close()
        self._clock = clock
        self._state = ServiceIntrospectionState(state)
        if self.is_on:
            publisher = self._node.handle.bridge.publisher
            self._publisher = publisher(self._srv_type.Event, self._topic, qos_profile.to_native())

    def publish(
        self, step: str, gid: list[int], number: int, request: Any = None, response: Any = None
    ) -> None:
        """Publish an event; `step` is its name in ServiceEventInfo."""
        publisher, clock = self._publisher, self._clock
        if publisher is None or clock is None:
            return
        contents = (request, response) if self._state is ServiceIntrospectionState.CONTENTS else ()
        stamp = clock.now().nanoseconds
        publisher.publish(service_event(self._srv_type, step, stamp, gid, number, *contents))

    def close(self) -> None:
        """Stop publishing."""
        publisher, self._publisher = self._publisher, None
        self._state = ServiceIntrospectionState.OFF
        if publisher is not None:
            publisher.close()
