"""Topics: a publisher's messages go to all subscriptions of the same name and type."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic

from taskrpc.core.execution.callbacks import HOLDS_LOOP_AFTER, Callback, CallbackRunner
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import OnMismatch, TopicSubscription
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.wire.frames import Body
from taskrpc.core.wire.messages import TopicEndpoint
from taskrpc.errors import InvalidRequest, TaskRpcError
from taskrpc.message_types import MsgT
from taskrpc.qos import QoS

if TYPE_CHECKING:
    from taskrpc.core.observer import TopicStatus

log = logging.getLogger("taskrpc.topics")

MOST_HANDED_OFF = 256
"""Messages that other threads have published and the event loop has not sent yet; a thread that
publishes more waits."""
A_TURN, A_TURN_BEHIND = 0.05, 0.005
"""Seconds for which the plain callback of a subscription may hold the event loop: normally, and
after it has fallen behind. Then other work runs, and messages beyond the depth are dropped. The
first is long, so that a quick callback does not count as slow on a busy machine."""
MOST_LOGGED = 100
"""How many invalid messages one subscription logs."""
_SLICE = 0.1
"""Seconds of one wait: on Windows, Ctrl-C does not interrupt a wait on a lock."""


class Publisher(Generic[MsgT]):
    """Publishes messages of one type on a topic; made by `Node.create_publisher`."""

    def __init__(
        self,
        transport: Endpoint,
        msg_type: type[MsgT],
        name: str,
        node: str,
        qos: QoS,
        role: Role,
        forget: Callable[[Publisher[MsgT]], object] = lambda _: None,
        on_mismatch: OnMismatch | None = None,
    ) -> None:
        self.msg_type = msg_type
        self.topic_name = name
        self.qos = qos
        own = named(msg_type, name, node, qos)
        self._transport = transport
        self._announced = own
        """What other processes see."""
        self._sender = transport.create_publisher(own, msg_type, role, on_mismatch)
        self._forget = forget
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._pending: list[bytes] = []
        """Messages of other threads that the event loop has not sent yet; protected by `_room`."""
        self._room = threading.Condition()
        """Notified when the event loop takes these messages."""
        self._destroyed = False
        self._iteration_began: float | None = None
        """When the present iteration of the loop first published; None if it has not."""
        self._warned = False
        """Whether the log has the warning about a blocked event loop."""

    def publish(self, message: MsgT) -> None:
        """Send a message to all subscriptions, without waiting for them; any thread may call it.

        Raises InvalidRequest for a message of another type, a value that does not fit its field, or
        more than 16 MiB; TaskRpcError once the publisher is destroyed.
        """
        self._refuse_destroyed()
        body = self._sender.encode(message)
        if threading.get_ident() == self._thread:
            if not self._sender.matched:
                self._warn_if_loop_is_blocked()
            self._sender.publish(body)
        else:
            self._hand_off(body)

    def get_subscription_count(self) -> int:
        """Return how many subscriptions get the messages."""
        return self._sender.matched

    @property
    def on_matched(self) -> Callable[[], object]:
        """A function that the event loop calls when the matching subscriptions change."""
        return self._sender.on_matched

    @on_matched.setter
    def on_matched(self, action: Callable[[], object]) -> None:
        self._sender.on_matched = action

    def set_alive(self, alive: bool) -> None:
        """Tell the subscriptions that it is alive, or that its lease has ended.

        A middleware such as Zenoh does not pass this on.
        """
        from taskrpc.core.transport.pubsub.publishing import LocalPublisher  # few programs need it

        if isinstance(self._sender, LocalPublisher):
            self._sender.set_alive(alive)

    def forget_latched(self) -> None:
        """Forget the published messages that are kept for later subscriptions."""
        self._sender.forget_latched()

    @property
    def sent(self) -> int:
        """Messages published so far."""
        return self._sender.sent

    @property
    def lost(self) -> int:
        """Messages that were not sent to a subscription because it does not read."""
        return self._sender.lost

    def destroy(self) -> None:
        """End the publisher."""
        if not self._destroyed:
            with self._room:
                self._destroyed = True
            self._send_pending()
            self._sender.close()
            self._transport.publisher_closed(self._announced)
            self._forget(self)

    def _warn_if_loop_is_blocked(self) -> None:
        """Warn a program that blocks the loop between messages: no subscription can connect."""
        now = self._loop.time()
        if self._iteration_began is None:
            self._iteration_began = now
            self._loop.call_soon(self._iteration_over)
        elif now - self._iteration_began > HOLDS_LOOP_AFTER and not self._warned:
            self._warned = True
            log.warning(
                "messages were published on %s for %.2f s while the event loop was blocked, so no"
                " subscription received them; write `await asyncio.sleep(...)` instead of"
                " `time.sleep(...)`, or use taskrpc.sync",
                self.topic_name,
                now - self._iteration_began,
            )

    def _iteration_over(self) -> None:
        self._iteration_began = None

    def _refuse_destroyed(self) -> None:
        if self._destroyed:
            raise TaskRpcError(f"the publisher of {self.topic_name} is destroyed")

    def _count_into(self, topics: dict[str, TopicStatus]) -> None:
        """Add its counts to those of its topic."""
        status = _status_of(topics, self.topic_name)
        status.published += self.sent
        status.lost_sending += self.lost
        status.subscriptions += self.get_subscription_count()

    def _hand_off(self, body: bytes) -> None:
        """Hand a message to the event loop, in order; wait while it has too many."""
        with self._room:
            while len(self._pending) >= MOST_HANDED_OFF and not self._destroyed:
                self._room.wait(_SLICE)
            self._refuse_destroyed()
            self._pending.append(body)
            if len(self._pending) == 1:
                self._transport.hand_over(self._send_pending)

    def _send_pending(self) -> None:
        with self._room:
            pending, self._pending = self._pending, []
            self._room.notify_all()
        for body in pending:
            self._sender.publish(body)


class Subscription(Generic[MsgT]):
    """Calls its callback with each message of a topic; made by `Node.create_subscription`.

    It makes one call at a time, in order. While a call runs, the last `depth` messages wait. Plain
    callbacks get a part of each iteration of the event loop; the remaining messages wait, too. As
    long as the topic has no publisher, the subscription receives from the topic `otherwise`.
    """

    def __init__(
        self,
        transport: Endpoint,
        msg_type: type[MsgT],
        name: str,
        node: str,
        callback: Callback,
        qos: QoS,
        *,
        threaded: bool = False,
        forget: Callable[[Subscription[MsgT]], object] = lambda _: None,
        on_mismatch: OnMismatch | None = None,
        otherwise: str = "",
    ) -> None:
        self.msg_type = msg_type
        self.topic_name = name
        self.qos = qos
        self.received = 0
        """Messages that arrived."""
        self.dropped = 0
        """Messages that arrived and were dropped because the callback was too slow."""
        self._forget = forget
        self._loop = asyncio.get_running_loop()
        self._runner = CallbackRunner(
            callback, f"the callback of {name}", "a message", threaded=threaded, idle=self._run
        )
        self._waiting: deque[Body] = deque()
        """Encoded messages for later calls, at most `depth`."""
        self._planned = False
        """Whether the next iteration of the loop will call `_run_planned`."""
        self._destroyed = False
        self._running = False
        """Whether `_run` is on the stack: the callback may publish on its own topic."""
        self._read = 0
        """The number of the transport's read that the last message came from."""
        self._is_behind = False
        """Whether messages wait longer than one iteration of the loop, or were dropped."""
        self._invalid = 0
        """How many messages could not be decoded."""
        self._transport = transport
        own = named(msg_type, name, node, qos)
        self._receiver = transport.create_subscription(own, msg_type, self._arrived, on_mismatch)
        self._announced = [own]
        """What other processes see."""
        self._elsewhere: TopicSubscription | None = None
        """The subscription of the topic `otherwise`, if there is one."""
        if otherwise:
            there = named(msg_type, otherwise, node, qos)
            arrived = self._arrived_elsewhere
            self._elsewhere = transport.create_subscription(there, msg_type, arrived, on_mismatch)
            self._announced.append(there)

    def get_publisher_count(self) -> int:
        """Return how many publishers send messages to it."""
        elsewhere = self._elsewhere
        return self._receiver.matched or (elsewhere.matched if elsewhere is not None else 0)

    def get_liveliness(self) -> tuple[int, int]:
        """Return how many of the publishers are alive, and how many are not.

        All publishers of a middleware such as Zenoh count as alive.
        """
        from taskrpc.core.transport.pubsub.subscribing import (
            LocalSubscription,  # few programs need it
        )

        if isinstance(self._receiver, LocalSubscription) and self._receiver.matched:
            return self._receiver.liveliness
        return self.get_publisher_count(), 0

    @property
    def on_matched(self) -> Callable[[], object]:
        """A function that the event loop calls when the matching publishers change."""
        return self._receiver.on_matched

    @on_matched.setter
    def on_matched(self, action: Callable[[], object]) -> None:
        self._receiver.on_matched = action
        if self._elsewhere is not None:
            self._elsewhere.on_matched = action

    @property
    def lost(self) -> int:
        """Messages that were published and did not arrive."""
        return self._receiver.lost + (self._elsewhere.lost if self._elsewhere is not None else 0)

    def destroy(self) -> None:
        """End the subscription.

        A callback that runs in the event loop is cancelled, unless it calls this itself.
        """
        if not self._destroyed:
            self._destroyed = True
            self._waiting.clear()
            self._receiver.close()
            if self._elsewhere is not None:
                self._elsewhere.close()
            for each in self._announced:
                self._transport.subscription_closed(each)
            self._runner.close()
            self._forget(self)

    def _count_into(self, topics: dict[str, TopicStatus]) -> None:
        """Add its counts to those of its topic."""
        status = _status_of(topics, self.topic_name)
        status.received += self.received
        status.lost_coming += self.lost
        status.lost_waiting += self.dropped
        status.publishers += self.get_publisher_count()

    def _arrived(self, body: Body, read: int) -> None:
        self.received += 1
        if read and read != self._read:
            self._read = read
            self._runner.spent = 0.0
            if self._is_behind:  # let the loop read on before the callback runs again
                self._is_behind = False
                self._plan()
        if len(self._waiting) >= self.qos.depth:
            self._waiting.popleft()
            self.dropped += 1
            self._is_behind = True
        self._waiting.append(body)
        if read:
            self._run()
        else:
            self._plan()

    def _arrived_elsewhere(self, body: Body, read: int) -> None:
        if not self._receiver.matched:
            self._arrived(body, read)

    def _plan(self) -> None:
        if not self._planned:
            self._planned = True
            self._loop.call_soon(self._run_planned)

    def _run_planned(self) -> None:
        self._planned = False
        self._runner.spent = 0.0
        self._run(A_TURN_BEHIND)

    def _run(self, seconds: float = A_TURN) -> None:
        if self._running or self._planned:  # called from within the callback
            return
        self._running = True
        left = len(self._waiting)  # a callback may publish on its own topic
        try:
            while left and self._can_run and self._runner.spent < seconds:
                left -= 1
                self._take(self._waiting.popleft())
        finally:
            self._running = False
            if self._can_run:
                self._is_behind = True
                self._plan()

    @property
    def _can_run(self) -> bool:
        return bool(self._waiting) and not self._runner.busy and not self._destroyed

    def _take(self, body: Body) -> None:
        try:
            message = self._receiver.decode(body)
        except InvalidRequest as error:
            self._invalid += 1
            if self._invalid <= MOST_LOGGED:
                log.error("a message of %s is not valid: %s", self.topic_name, error)
        else:
            self._runner.run(message)


def _status_of(topics: dict[str, TopicStatus], name: str) -> TopicStatus:
    from taskrpc.core.observer import TopicStatus  # few programs need it

    return topics.setdefault(name, TopicStatus())


def named(msg_type: Any, name: str, node: str, qos: QoS) -> TopicEndpoint:
    """Return the description of a publisher or subscription for other processes."""
    type_name, type_hash = msg_type._TYPE, msg_type._HASH
    return TopicEndpoint(
        name, type_name, type_hash, node, qos.depth, qos.is_reliable, qos.is_latched, qos.timing
    )
