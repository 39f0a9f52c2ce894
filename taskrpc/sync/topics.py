"""Publishers, subscriptions and timers of nodes that block."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic

from taskrpc import node as _node
from taskrpc import timer as _timer
from taskrpc import topic as _topic
from taskrpc.message_types import MsgT
from taskrpc.qos import QoS
from taskrpc.security.roles import Role
from taskrpc.sync.loop_thread import LoopThread
from taskrpc.transport.base import OnMismatch

if TYPE_CHECKING:
    from taskrpc.introspection import IntrospectionState
    from taskrpc.service import Service


class Publisher(Generic[MsgT]):
    """Publishes messages of one type on a topic; from several threads at once if need be."""

    def __init__(self, loop: LoopThread, inner: _topic.Publisher[MsgT]) -> None:
        self._loop = loop
        self._inner = inner
        self.msg_type = inner.msg_type
        self.topic_name = inner.topic_name
        self.qos = inner.qos

    def publish(self, message: MsgT) -> None:
        """Send a message to all subscriptions; errors as in `taskrpc.Publisher.publish`."""
        self._loop.refuse_without_loop("publish()")
        self._inner.publish(message)

    def watch_matches(self, changed: Callable[[], object]) -> None:
        """Call `changed` now and whenever the number of matching subscriptions changes.

        It is called on the thread of the event loop.
        """

        def begin() -> None:
            self._inner.on_matched = changed
            changed()

        self._loop.soon(begin)

    def get_subscription_count(self) -> int:
        """How many subscriptions get the messages."""
        return self._inner.get_subscription_count()

    @property
    def sent(self) -> int:
        """Messages published so far."""
        return self._inner.sent

    @property
    def lost(self) -> int:
        """Messages that subscriptions did not get, since they do not read; counted for each."""
        return self._inner.lost

    def destroy(self) -> None:
        """Publish no more."""
        self._loop.do(self._inner.destroy, "destroy()")


class Subscription(Generic[MsgT]):
    """Calls its callback, in a thread of its own, with each message of a topic."""

    def __init__(self, loop: LoopThread, inner: _topic.Subscription[MsgT]) -> None:
        self._loop = loop
        self._inner = inner
        self.msg_type = inner.msg_type
        self.topic_name = inner.topic_name
        self.qos = inner.qos

    def watch_matches(self, changed: Callable[[], object]) -> None:
        """Call `changed` now and whenever the number of matching publishers changes.

        It is called on the thread of the event loop.
        """

        def begin() -> None:
            self._inner.on_matched = changed
            changed()

        self._loop.soon(begin)

    def get_publisher_count(self) -> int:
        """How many publishers send messages to it."""
        return self._inner.get_publisher_count()

    @property
    def received(self) -> int:
        """Messages that came."""
        return self._inner.received

    @property
    def dropped(self) -> int:
        """Messages that came and were dropped, since the callback was behind."""
        return self._inner.dropped

    @property
    def lost(self) -> int:
        """Messages that were published and did not come."""
        return self._inner.lost

    def destroy(self) -> None:
        """Want no more messages; a callback that runs is not stopped."""
        self._loop.do(self._inner.destroy, "destroy()")


class Timer:
    """Calls its callback, in a thread of its own, every `period` seconds."""

    def __init__(self, loop: LoopThread, inner: _timer.Timer) -> None:
        self._loop = loop
        self._inner = inner
        self.period = inner.period

    @property
    def is_canceled(self) -> bool:
        """Whether it stands still; `reset` starts it again."""
        return self._inner.is_canceled

    def cancel(self) -> None:
        """Stand still; a call that runs is not stopped."""
        self._loop.do(self._inner.cancel, "cancel()")

    def reset(self) -> None:
        """Start again: the next call is `period` seconds from now."""
        self._loop.do(self._inner.reset, "reset()")

    def destroy(self) -> None:
        """Stop for ever; a call that runs is not stopped."""
        self._loop.do(self._inner.destroy, "destroy()")


class SyncTopics:
    """The part of a blocking node that publishes, subscribes and keeps time."""

    _loop: LoopThread
    _node: _node.Node

    def create_publisher(
        self,
        msg_type: type[MsgT],
        topic: str,
        qos: QoS | int = 10,
        *,
        role: Role = Role.OBSERVE,
        on_mismatch: OnMismatch | None = None,
    ) -> Publisher[MsgT]:
        """Publish messages of a type on a topic; as `taskrpc.Node.create_publisher`."""
        inner = self._loop.do(
            lambda: self._node.create_publisher(
                msg_type, topic, qos, role=role, on_mismatch=on_mismatch
            ),
            "create_publisher()",
        )
        return Publisher(self._loop, inner)

    def create_subscription(
        self,
        msg_type: type[MsgT],
        topic: str,
        callback: Callable[[MsgT], object],
        qos: QoS | int = 10,
        *,
        threaded: bool = True,
        on_mismatch: OnMismatch | None = None,
    ) -> Subscription[MsgT]:
        """Call `callback(message)` for each message of a topic.

        As `taskrpc.Node.create_subscription`, but plain callbacks run in a thread.
        """
        inner = self._loop.do(
            lambda: self._node.create_subscription(
                msg_type,
                topic,
                callback,
                qos,
                threaded=_in_thread(callback, threaded),
                on_mismatch=on_mismatch,
            ),
            "create_subscription()",
        )
        return Subscription(self._loop, inner)

    def configure_introspection(
        self, service: Service, state: IntrospectionState, qos: QoS | int = 100
    ) -> None:
        """Tell each call of this node's service; as `taskrpc.Node.configure_introspection`."""
        self._loop.do(
            lambda: self._node.configure_introspection(service, state, qos),
            "configure_introspection()",
        )

    def create_timer(
        self, period: float, callback: Callable[[], object], *, threaded: bool = True
    ) -> Timer:
        """Call `callback()` every `period` seconds, in a thread if it is plain."""
        inner = self._loop.do(
            lambda: self._node.create_timer(
                period, callback, threaded=_in_thread(callback, threaded)
            ),
            "create_timer()",
        )
        return Timer(self._loop, inner)


def _in_thread(callback: Callable[..., object], threaded: bool) -> bool:
    return threaded and not inspect.iscoroutinefunction(callback)
