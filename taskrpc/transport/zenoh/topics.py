"""Native topics over Zenoh: publishers and subscriptions, as rmw_zenoh has them."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh import ext

import srvgen
from taskrpc.errors import InvalidRequest
from taskrpc.transport.base import Deliver
from taskrpc.transport.zenoh import attachment
from taskrpc.transport.zenoh.session import HandOff
from taskrpc.wire.frames import Body
from taskrpc.wire.messages import TopicEndpoint

HEARTBEAT = 0.5
"""Seconds between two announcements of a reliable transient_local publisher's last message, as in
rmw_zenoh."""
MAX_GIDS = 1024
"""Publishers whose sequence numbers a subscription remembers."""


class ZenohPublisher:
    """A native publisher. `matched` counts the subscriptions now; `on_close` is called once."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        token: str,
        named: TopicEndpoint,
        msg_type: Any,
        matched: Callable[[], int],
        on_close: Callable[[ZenohPublisher], object],
    ) -> None:
        self.named = named
        self.sent = 0
        self.lost = 0
        self.on_matched: Callable[[], object] = _nothing
        self._session = session
        self._key = key
        self._msg_type = msg_type
        self._matched = matched
        self._on_close = on_close
        self._gid = os.urandom(attachment.GID_SIZE)
        self._publisher: Any = self._declare()  # plain or advanced
        self._token = session.liveliness().declare_token(token)

    @property
    def matched(self) -> int:
        """How many subscriptions get its messages."""
        return self._matched()

    def encode(self, message: Any) -> bytes:
        """Return the message as CDR. Raises InvalidRequest."""
        expected = self._msg_type
        # A message with checked fields has a class of its own, made from the original.
        if type(message) is not expected and getattr(message, "_ORIGINAL", None) is not expected:
            got = getattr(type(message), "_TYPE", type(message).__name__)
            raise InvalidRequest("", f"expected a {expected._TYPE}, got {got}")
        try:
            return srvgen.to_cdr(message)
        except ValueError as error:
            path, problem = getattr(error, "path", ""), getattr(error, "problem", str(error))
            raise InvalidRequest(path, problem) from None

    def publish(self, body: bytes) -> None:
        """Send an encoded message to all subscriptions."""
        self.sent += 1
        about = attachment.pack(self.sent, time.time_ns(), self._gid)
        self._publisher.put(body, attachment=about)

    def forget_latched(self) -> None:
        """Forget the messages that are kept for later subscriptions."""
        if self.named.latched:
            self._publisher.undeclare()
            self._publisher = self._declare()

    def close(self) -> None:
        """End the publisher."""
        self._token.undeclare()
        self._publisher.undeclare()
        self._on_close(self)

    def _declare(self) -> zenoh.Publisher | ext.AdvancedPublisher:
        named = self.named
        reliability = (
            zenoh.Reliability.RELIABLE if named.reliable else zenoh.Reliability.BEST_EFFORT
        )
        # Reliable messages wait for room on the way to the router.
        congestion = zenoh.CongestionControl
        control = congestion.BLOCK if named.reliable else congestion.DROP
        if not named.latched:
            return self._session.declare_publisher(
                self._key, congestion_control=control, reliability=reliability
            )
        # Both arguments are required; exactly one of them may have a value.
        detection = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT)
        return ext.declare_advanced_publisher(
            self._session,
            self._key,
            congestion_control=control,
            reliability=reliability,
            cache=ext.CacheConfig(named.depth),
            sample_miss_detection=detection if named.reliable else None,
            publisher_detection=True,
        )


class ZenohSubscription:
    """A native subscription. `matched` counts the publishers; `on_close` is called once."""

    def __init__(
        self,
        session: zenoh.Session,
        hand_off: HandOff,
        key: str,
        token: str,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        matched: Callable[[], int],
        on_close: Callable[[ZenohSubscription], object],
    ) -> None:
        self.named = named
        self.lost = 0
        self.on_matched: Callable[[], object] = _nothing
        self.decode: Callable[[Body], Any] = _decoder(msg_type)
        self._hand_off = hand_off
        self._deliver = deliver
        self._matched = matched
        self._on_close = on_close
        self._closed = False
        self._last: dict[bytes, int] = {}
        """The sequence number of the last message of each publisher, by its gid."""
        self._subscriber: Any = self._declare(session, key)  # plain or advanced
        self._token = session.liveliness().declare_token(token)

    @property
    def matched(self) -> int:
        """How many publishers send messages to it."""
        return self._matched()

    def close(self) -> None:
        """End the subscription."""
        self._closed = True
        self._token.undeclare()
        self._subscriber.undeclare()
        self._on_close(self)

    def _declare(
        self, session: zenoh.Session, key: str
    ) -> zenoh.Subscriber[Any] | ext.AdvancedSubscriber[Any]:
        handler = self._hand_off.callback(self._arrived)
        if not self.named.latched:
            return session.declare_subscriber(key, handler)
        recovery = ext.RecoveryConfig(periodic_queries=None, heartbeat=True)
        history = ext.HistoryConfig(detect_late_publishers=True, max_samples=self.named.depth)
        return ext.declare_advanced_subscriber(
            session,
            key,
            handler,
            history=history,
            recovery=recovery if self.named.reliable else None,
            subscriber_detection=True,
        )

    def _arrived(self, sample: zenoh.Sample) -> None:
        if self._closed:
            return
        if sample.attachment is not None:
            self._count_lost(sample.attachment.to_bytes())
        self._deliver(sample.payload.to_bytes(), self._hand_off.turn)

    def _count_lost(self, data: bytes) -> None:
        about = attachment.parse(data)
        if about is None:
            return
        last = self._last.pop(about.gid, None)
        if last is not None and about.sequence > last + 1:
            self.lost += about.sequence - last - 1
        self._last[about.gid] = about.sequence  # at the end: the first one is the most silent
        if len(self._last) > MAX_GIDS:
            del self._last[next(iter(self._last))]


def _decoder(msg_type: Any) -> Callable[[Body], Any]:
    def decode(body: Body) -> Any:
        try:
            return srvgen.from_cdr(msg_type, body)
        except srvgen.CdrError as error:
            raise InvalidRequest("", f"the message is not valid: {error}") from None

    return decode


def _nothing() -> None:
    """The default of `on_matched`."""
