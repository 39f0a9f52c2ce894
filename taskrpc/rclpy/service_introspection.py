"""Service introspection: every step of a call told on the topic `SERVICE/_service_event`."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

from taskrpc.introspection import SUFFIX, service_event

from ._impl.node_interface import NodeInterface
from .qos import QoSProfile

if TYPE_CHECKING:
    from .clock import Clock


class ServiceIntrospectionState(IntEnum):
    """How much is told: nothing, that something happened, or the messages, too."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class Introspection:
    """What one client or service tells of its calls; nothing before `configure`."""

    def __init__(self, node: NodeInterface, srv_type: Any, service: str) -> None:
        self._node = node
        self._srv_type = srv_type
        self._topic = f"{service}{SUFFIX}"
        self._state = ServiceIntrospectionState.OFF
        self._publisher: Any = None
        self._clock: Clock | None = None

    @property
    def is_on(self) -> bool:
        """Whether anything is to be told."""
        return self._state is not ServiceIntrospectionState.OFF

    def configure(
        self, clock: Clock, qos_profile: QoSProfile, state: ServiceIntrospectionState
    ) -> None:
        """Tell so much from now on, with this clock's time."""
        self.close()
        self._clock = clock
        self._state = ServiceIntrospectionState(state)
        if self.is_on:
            publisher = self._node.handle.bridge.publisher
            self._publisher = publisher(self._srv_type.Event, self._topic, qos_profile.to_native())

    def tell(
        self, step: str, gid: list[int], number: int, request: Any = None, response: Any = None
    ) -> None:
        """Tell of a step by the name that ServiceEventInfo has for it."""
        publisher, clock = self._publisher, self._clock
        if publisher is None or clock is None:
            return
        told = (request, response) if self._state is ServiceIntrospectionState.CONTENTS else ()
        stamp = clock.now().nanoseconds
        publisher.publish(service_event(self._srv_type, step, stamp, gid, number, *told))

    def close(self) -> None:
        """Tell nothing more."""
        publisher, self._publisher = self._publisher, None
        self._state = ServiceIntrospectionState.OFF
        if publisher is not None:
            publisher.close()
