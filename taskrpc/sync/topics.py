"""Publishers, subscriptions and timers of blocking nodes.

Each object passes its methods on to the asynchronous one behind it. Methods that must run on the
event loop run there; the others are safe in any thread.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic

from taskrpc import timer as _timer
from taskrpc import topic as _topic
from taskrpc.message_types import MsgT
from taskrpc.sync.loop_thread import LoopThread


class _TopicEndpoint(Generic[MsgT]):
    """The common part of publishers and subscriptions."""

    _inner: _topic.Publisher[MsgT] | _topic.Subscription[MsgT]

    def __init__(
        self, loop: LoopThread, inner: _topic.Publisher[MsgT] | _topic.Subscription[MsgT]
    ) -> None:
        self._loop = loop
        self._inner = inner
        self.msg_type = inner.msg_type
        self.topic_name = inner.topic_name
        self.qos = inner.qos

    def watch_matches(self, changed: Callable[[], object]) -> None:
        """Call `changed` now and whenever the number of matching endpoints changes.

        It is called on the thread of the event loop.
        """

        def begin() -> None:
            self._inner.on_matched = changed
            changed()

        self._loop.soon(begin)


class Publisher(_TopicEndpoint[MsgT]):
    """Publishes messages of one type on a topic; several threads may use it at once."""

    _inner: _topic.Publisher[MsgT]

    def publish(self, message: MsgT) -> None:
        """Send a message to all subscriptions; errors as in `taskrpc.Publisher.publish`."""
        self._loop.refuse_without_loop("publish()")
        self._inner.publish(message)

    def set_alive(self, alive: bool) -> None:
        """Tell the subscriptions whether it is alive; only on the loop's thread."""
        self._inner.set_alive(alive)

    def get_subscription_count(self) -> int:
        """Return how many subscriptions get the messages."""
        return self._inner.get_subscription_count()

    @property
    def sent(self) -> int:
        """Messages published so far."""
        return self._inner.sent

    @property
    def lost(self) -> int:
        """Messages that were not sent because a subscription does not read, for each one."""
        return self._inner.lost

    def destroy(self) -> None:
        """End the publisher."""
        self._loop.do(self._inner.destroy, "destroy()")


class Subscription(_TopicEndpoint[MsgT]):
    """Calls its callback, in a thread of its own, with each message of a topic."""

    _inner: _topic.Subscription[MsgT]

    def get_publisher_count(self) -> int:
        """Return how many publishers send messages to it."""
        return self._inner.get_publisher_count()

    def get_liveliness(self) -> tuple[int, int]:
        """Return how many of the publishers are alive, and how many are not."""
        return self._inner.get_liveliness()

    @property
    def received(self) -> int:
        """Messages that arrived."""
        return self._inner.received

    @property
    def dropped(self) -> int:
        """Messages that arrived and were dropped because the callback was too slow."""
        return self._inner.dropped

    @property
    def lost(self) -> int:
        """Messages that were published and did not arrive."""
        return self._inner.lost

    def destroy(self) -> None:
        """End the subscription; a running callback is not stopped."""
        self._loop.do(self._inner.destroy, "destroy()")


class Timer:
    """Calls its callback, in a thread of its own, every `period` seconds."""

    def __init__(self, loop: LoopThread, inner: _timer.Timer) -> None:
        self._loop = loop
        self._inner = inner
        self.period = inner.period

    @property
    def is_canceled(self) -> bool:
        """Whether the timer is stopped; `reset` starts it again."""
        return self._inner.is_canceled

    def cancel(self) -> None:
        """Stop the timer; a running callback is not stopped."""
        self._loop.do(self._inner.cancel, "cancel()")

    def reset(self) -> None:
        """Restart the timer: the next call is `period` seconds from now."""
        self._loop.do(self._inner.reset, "reset()")

    def destroy(self) -> None:
        """Stop the timer for good; a running callback is not stopped."""
        self._loop.do(self._inner.destroy, "destroy()")
