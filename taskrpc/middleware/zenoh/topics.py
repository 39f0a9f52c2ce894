"""Native topics over Zenoh: publishers and subscriptions, as rmw_zenoh has them."""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import zenoh
from zenoh import ext

from taskrpc.middleware.zenoh import attachment
from taskrpc.middleware.zenoh.graph import Graph
from taskrpc.middleware.zenoh.session import handler
from taskrpc.middleware.zenoh.tokens import Kind, Token
from taskrpc.spi import Body, Deliver, Handoff, OnMismatch, TopicEndpoint, cdr

log = logging.getLogger("taskrpc.transport")

HEARTBEAT = 0.5
"""Seconds between two announcements of a reliable transient_local publisher's last message, as in
rmw_zenoh."""
MAX_GIDS = 1024
"""Publishers whose sequence numbers a subscription remembers."""
MAX_WARNINGS = 100
"""The most differing types that one publisher or subscription logs: foreign programs could cause
any number of them."""


class TopicSetup(msgspec.Struct, frozen=True):
    """The session of a publisher or subscription, and its keys."""

    session: zenoh.Session
    graph: Graph
    key: str
    """The key of its messages."""
    token: str
    """The key of its liveliness token."""
    on_close: Callable[[NativeTopic], object]
    """Called once, when it is closed."""


class NativeTopic:
    """What a native publisher and a native subscription have in common."""

    counterpart: Kind
    """What it exchanges messages with."""

    def __init__(
        self, setup: TopicSetup, named: TopicEndpoint, on_mismatch: OnMismatch | None = None
    ) -> None:
        self.named = named
        self.on_matched: Callable[[], object] = _nothing
        self._setup = setup
        self._on_mismatch = on_mismatch
        self._warnings = 0
        self._loop = asyncio.get_running_loop()
        self._token = setup.session.liveliness().declare_token(setup.token)
        for token in setup.graph.named(self.counterpart, named.name):
            self.appeared(token)

    @property
    def token(self) -> str:
        """The key of its liveliness token."""
        return self._setup.token

    @property
    def matched(self) -> int:
        """How many subscriptions or publishers it exchanges messages with."""
        tokens = self._setup.graph.named(self.counterpart, self.named.name)
        return sum(self._is_same_type(token) for token in tokens)

    def appeared(self, token: Token) -> None:
        """Note a counterpart of the same name: report it, or that it has another type."""
        if self._is_same_type(token):
            self.counterparts_changed()
        elif self._warnings < MAX_WARNINGS:
            self._warnings += 1
            if self._on_mismatch is None:
                log.warning("%s", _different(self.named, token))
            else:
                self._loop.call_soon(partial(self._on_mismatch, "TYPE"))

    def counterparts_changed(self) -> None:
        """Call `on_matched` in a later turn of the loop."""
        self._loop.call_soon(self._report)

    def close(self) -> None:
        """End it."""
        self._token.undeclare()
        self._setup.on_close(self)

    def _report(self) -> None:
        # The program may set `on_matched` after the match, in the same turn of the loop.
        self.on_matched()

    def _is_same_type(self, token: Token) -> bool:
        named = self.named
        return (named.type_name, named.type_hash) == (token.type_name, token.type_hash)


def _different(named: TopicEndpoint, token: Token) -> str:
    publishes = token.kind is Kind.PUBLISHER
    publisher, subscriber = (token, named) if publishes else (named, token)
    return (
        f"{publisher.node} publishes {named.name} as {publisher.type_name} with the hash"
        f" {publisher.type_hash[:15]}…, {subscriber.node} subscribes to it as"
        f" {subscriber.type_name} with {subscriber.type_hash[:15]}…: they exchange no messages; use"
        " the same definition in both programs"
    )


class ZenohPublisher(NativeTopic):
    """A native publisher."""

    counterpart = Kind.SUBSCRIPTION

    def __init__(
        self, setup: TopicSetup, named: TopicEndpoint, msg_type: Any, on_mismatch: OnMismatch | None
    ) -> None:
        self.sent = 0
        self.lost = 0
        self._msg_type = msg_type
        self._gid = os.urandom(attachment.GID_SIZE)
        self._publisher = _declare_publisher(setup, named)
        super().__init__(setup, named, on_mismatch)

    def encode(self, message: Any) -> bytes:
        """Return the message as CDR. Raises InvalidRequest."""
        return cdr.encode(self._msg_type, message)

    def publish(self, body: bytes) -> None:
        """Send an encoded message to all subscriptions."""
        self.sent += 1
        about = attachment.pack(self.sent, time.time_ns(), self._gid)
        self._publisher.put(body, attachment=about)

    def forget_latched(self) -> None:
        """Forget the messages that are kept for later subscriptions."""
        if self.named.latched:
            self._publisher.undeclare()
            self._publisher = _declare_publisher(self._setup, self.named)

    def close(self) -> None:
        """End the publisher."""
        super().close()
        self._publisher.undeclare()


def _declare_publisher(setup: TopicSetup, named: TopicEndpoint) -> Any:
    """Return a publisher of Zenoh; one with a cache for transient_local."""
    level, congestion = zenoh.Reliability, zenoh.CongestionControl
    reliability = level.RELIABLE if named.reliable else level.BEST_EFFORT
    # Reliable messages wait for room on the way to the router; others are dropped.
    control = congestion.BLOCK if named.reliable else congestion.DROP
    if not named.latched:
        return setup.session.declare_publisher(
            setup.key, congestion_control=control, reliability=reliability
        )
    # Both arguments are required; exactly one of them may have a value.
    detection = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT)
    return ext.declare_advanced_publisher(
        setup.session,
        setup.key,
        congestion_control=control,
        reliability=reliability,
        cache=ext.CacheConfig(named.depth),
        sample_miss_detection=detection if named.reliable else None,
        publisher_detection=True,
    )


class ZenohSubscription(NativeTopic):
    """A native subscription."""

    counterpart = Kind.PUBLISHER

    def __init__(
        self,
        setup: TopicSetup,
        handoff: Handoff,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None,
    ) -> None:
        self.lost = 0
        self.decode: Callable[[Body], Any] = partial(cdr.decode, msg_type)
        self._handoff = handoff
        self._deliver: Deliver | None = deliver
        """None once it is closed."""
        self._last: dict[bytes, int] = {}
        """The sequence number of the last message of each publisher, by its gid."""
        self._subscriber = _declare_subscriber(setup, named, handler(handoff, self._arrived))
        super().__init__(setup, named, on_mismatch)

    def close(self) -> None:
        """End the subscription."""
        super().close()
        self._subscriber.undeclare()
        # Zenoh 1.7 keeps the handler of an advanced subscriber, and so this object.
        self._deliver = None
        self.on_matched, self._on_mismatch = _nothing, None

    def _arrived(self, sample: zenoh.Sample) -> None:
        if self._deliver is None:
            return
        if sample.attachment is not None:
            self._count_lost(sample.attachment.to_bytes())
        self._deliver(sample.payload.to_bytes(), self._handoff.turn)

    def _count_lost(self, data: bytes) -> None:
        about = attachment.parse(data)
        if about is None:
            return
        last = self._last.pop(about.gid, None)
        if last is not None and about.sequence > last + 1:
            self.lost += about.sequence - last - 1
        # Moved to the end: the first publisher is the one that was silent longest.
        self._last[about.gid] = about.sequence
        if len(self._last) > MAX_GIDS:
            del self._last[next(iter(self._last))]


def _declare_subscriber(setup: TopicSetup, named: TopicEndpoint, arrived: Any) -> Any:
    """Return a subscriber of Zenoh; one that asks for earlier messages for transient_local."""
    if not named.latched:
        return setup.session.declare_subscriber(setup.key, arrived)
    recovery = ext.RecoveryConfig(periodic_queries=None, heartbeat=True)
    return ext.declare_advanced_subscriber(
        setup.session,
        setup.key,
        arrived,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=named.depth),
        recovery=recovery if named.reliable else None,
        subscriber_detection=True,
    )


def _nothing() -> None:
    """The default of `on_matched`."""
