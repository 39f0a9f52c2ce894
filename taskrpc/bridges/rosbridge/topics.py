"""Topics for clients of rosbridge: their subscriptions and their publishers."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any

from taskrpc.bridges.rosbridge.graph import Graph
from taskrpc.bridges.rosbridge.protocol import (
    Advertise,
    Id,
    Subscribe,
    Throttle,
    count_of,
    encode,
    split,
)
from taskrpc.bridges.rosbridge.types import message_class
from taskrpc.bridges.rosbridge.values import Stamp, from_json, to_json
from taskrpc.errors import TaskRpcError
from taskrpc.node import Node
from taskrpc.qos import QoS, qos_for_all

_MAX_DEPTH = 1_000
"""Most messages that the gateway keeps for one topic of one client."""
_MAX_RATE = 3_600_000
"""Most milliseconds between two messages of a throttled topic."""
_MAX_IDS = 256
"""Most subscriptions of one client to one topic, and most ids with which it advertises one."""
_HOLD = 1.0
"""Seconds for which a new publisher keeps messages until the subscriptions are connected."""


class ClientSubscription:
    """The subscriptions of one client to one topic; it gets each message once.

    `is_behind` returns whether the client has much to read: then only the newest message waits for
    it, until `drained` is called.
    """

    def __init__(
        self,
        node: Node,
        operation: Subscribe,
        graph: Graph,
        send: Callable[[str], object],
        is_behind: Callable[[], bool],
        on_mismatch: Callable[[str], object],
    ) -> None:
        self._topic = operation.topic  # as the client spells it, because it compares the names
        self._send = send
        self._is_behind = is_behind
        self._loop = asyncio.get_running_loop()
        self._wanted: dict[Id, Subscribe] = {}
        """The client's subscriptions, by id."""
        self._timer: asyncio.TimerHandle | None = None
        self._late: Any = None
        """The newest message that arrived while the client was behind."""
        self._sent = 0
        self._throttle: Throttle[Any] = Throttle(0.0, 0)
        self._fragment_size = 0
        topic = node.resolve_topic_name(operation.topic)
        publishers = graph.publishers_of(topic)
        self._cls = message_class(operation.type or graph.type_of(topic))
        _check_type(topic, operation.type, self._cls, graph.type_of(topic))
        self.add(operation)
        depth = count_of(operation.queue_length, 100, _MAX_DEPTH) or 100
        qos = qos_for_all(publishers, depth)
        self._subscription = node.create_subscription(
            self._cls, operation.topic, self._arrived, qos, on_mismatch=on_mismatch
        )

    def add(self, operation: Subscribe) -> None:
        """Add a subscription of the client, or replace the one with the same id."""
        if operation.type:
            cls = message_class(operation.type)
            _check_type(operation.topic, operation.type, cls, self._cls._TYPE)
        if operation.id not in self._wanted and len(self._wanted) >= _MAX_IDS:
            raise TaskRpcError(f"expected at most {_MAX_IDS} subscriptions of one topic")
        self._wanted[operation.id] = operation
        self._apply()

    def remove(self, name: Id) -> bool:
        """Remove the subscription of this id, or all without one; return whether none is left.

        Raises TaskRpcError.
        """
        if name is None:
            self._wanted.clear()
        elif self._wanted.pop(name, None) is None:
            raise TaskRpcError(f"no subscription of {self._topic} has the id {name!r}")
        if self._wanted:
            self._apply()
        return not self._wanted

    def _apply(self) -> None:
        """Combine what the subscriptions want, as rosbridge prescribes."""
        wanted = self._wanted.values()
        rate = min(count_of(each.throttle_rate, 0, _MAX_RATE) for each in wanted) / 1000
        length = max(count_of(each.queue_length, 0, _MAX_DEPTH) for each in wanted)
        sizes = [count_of(each.fragment_size, 0, 2**31) for each in wanted]
        self._fragment_size = min(filter(None, sizes), default=0)
        self._throttle = Throttle(rate, length)

    def close(self) -> None:
        """End the subscription."""
        self._subscription.destroy()
        if self._timer is not None:
            self._timer.cancel()

    def drained(self) -> None:
        """Send the newest message that the client has missed, now that it reads again."""
        late, self._late = self._late, None
        if late is not None:
            self._arrived(late)
        self._plan()

    def _arrived(self, message: Any) -> None:
        if self._is_behind():
            self._late = message
        elif self._throttle.offer(message, self._loop.time()):
            self._pass_on(message)
        else:
            self._plan()

    def _plan(self) -> None:
        due = self._throttle.due
        if due is not None and self._timer is None:
            self._timer = self._loop.call_at(due, self._is_due)

    def _is_due(self) -> None:
        self._timer = None
        if self._is_behind():
            return  # `drained` continues
        message = self._throttle.take(self._loop.time())
        if message is not None:
            self._pass_on(message)
        self._plan()

    def _pass_on(self, message: Any) -> None:
        self._sent += 1
        text = encode({"op": "publish", "topic": self._topic, "msg": to_json(message)})
        for part in split(text, self._fragment_size, f"publish:{self._topic}:{self._sent}"):
            self._send(part)


class ClientPublisher:
    """A client's publisher of one topic.

    Clients publish right after they advertise. So a new publisher keeps the first messages until
    the subscriptions that exist are connected.
    """

    def __init__(
        self,
        node: Node,
        operation: Advertise,
        graph: Graph,
        on_mismatch: Callable[[str], object],
    ) -> None:
        self._topic = topic = node.resolve_topic_name(operation.topic)
        self._cls = message_class(operation.type)
        self.type_name: str = self._cls._TYPE
        _check_type(topic, operation.type, self._cls, graph.type_of(topic))
        self._ids: set[Id] = set()
        depth = count_of(operation.queue_size, 100, _MAX_DEPTH) or 100
        qos = QoS(depth, durability="transient_local" if operation.latch else "volatile")
        self._publisher = node.create_publisher(
            self._cls, operation.topic, qos, on_mismatch=on_mismatch
        )
        self._expected = len(graph.subscriptions_of(topic))
        self._held: deque[Any] | None = deque(maxlen=depth)
        """Messages that wait for the subscriptions; None once they are connected."""
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(_HOLD, self._release)
        self._publisher.on_matched = self._matched
        self.add(operation)
        self._matched()

    def add(self, operation: Advertise) -> None:
        """Note that the client has advertised the topic once more. Raises TaskRpcError."""
        cls = message_class(operation.type)
        _check_type(operation.topic, operation.type, cls, self._cls._TYPE)
        if operation.id not in self._ids and len(self._ids) >= _MAX_IDS:
            raise TaskRpcError(f"expected at most {_MAX_IDS} ids that advertise one topic")
        self._ids.add(operation.id)

    def remove(self, name: Id) -> bool:
        """Note that the client does not advertise any more; return whether no id is left.

        Raises TaskRpcError.
        """
        if name is None:
            self._ids.clear()
        elif name not in self._ids:
            raise TaskRpcError(f"the client has not advertised {self._topic} with the id {name!r}")
        self._ids.discard(name)
        return not self._ids

    def publish(self, value: object, now: Stamp) -> None:
        """Publish a message from its JSON value. Raises FieldError, InvalidRequest."""
        message = from_json(self._cls, {} if value is None else value, now)
        if self._held is None:
            self._publisher.publish(message)
        else:
            self._held.append(message)

    def close(self) -> None:
        """End the publisher; messages that wait are sent to the subscriptions so far."""
        self._release()
        self._publisher.destroy()

    def _matched(self) -> None:
        if self._publisher.get_subscription_count() >= self._expected:
            self._release()

    def _release(self) -> None:
        self._timer.cancel()
        held, self._held = self._held, None
        for message in held or ():
            self._publisher.publish(message)


def _check_type(topic: str, wanted: str | None, cls: Any, known: str) -> None:
    """Raise TaskRpcError if a topic has another type than the client wants."""
    if known and known != cls._TYPE:
        raise TaskRpcError(f"the topic {topic} has the type {known}, not {wanted}")
