"""What nodes and their endpoint pass to each other: offers, incoming calls, topics, statistics.

Nodes use an `Endpoint`, which is the same for every transport; it passes typed messages and encodes
them. The author of a transport implements `network.Network` or `engine.Engine` instead.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Hashable
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import msgspec

from taskrpc.core.callinfo import CallInfo
from taskrpc.core.request_ids.ids import Completion, ReceivedId
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.codec import ServiceType
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.frames import Body
from taskrpc.core.wire.messages import TopicEndpoint
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.core.observer import Observer
    from taskrpc.core.request_ids.ledger import ClientRecord, Ledger
    from taskrpc.core.wire.statistics import Statistics

DEFAULT_TIMEOUT = 10.0
"""Seconds until the deadline of a call without a timeout of its own."""


class Mode(IntEnum):
    """What a server promises about repeated requests of one service."""

    AT_MOST_ONCE = 0
    IDEMPOTENT = 1
    EXACTLY_ONCE = 2


class CallNumbers:
    """Counts the calls of a server, for log lines."""

    __slots__ = ("last",)

    def __init__(self) -> None:
        self.last = 0
        """The number of the latest call. Add 1 for the next one: a method would cost more."""

    def next(self) -> int:
        """Return the number of the next call."""
        self.last += 1
        return self.last


class IncomingCall(CallInfo, eq=False, kw_only=True):
    """A call that arrived. End it with exactly one of `reply` and `fail`."""

    request: Any
    on_cancel: Callable[[], object] | None = None
    """Called by `cancel`; the service sets it when it runs the call and can stop it."""
    started: bool = False
    """Whether the service has begun to run the call; the service sets it."""
    received_id: ReceivedId | None = None
    """The request id; None if the service is not exactly-once."""
    arrived: float
    """When the request was read, on the loop's clock."""

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Send a response message; `body` is the message encoded by its `Codec`, if known.

        Raises InvalidRequest for a response that cannot be sent; the call stays open then.
        """
        raise NotImplementedError

    def reply_in_thread(self, body: bytes) -> bool:
        """Send a response from another thread; False if only the event loop can send it."""
        return False

    def fail(self, error: TaskRpcError) -> None:
        """Send an error."""
        raise NotImplementedError

    @property
    def flow(self) -> Hashable:
        """The key in the fair queue; calls with the same key run in order of arrival."""
        return self.principal or self.caller

    def must_wait(self) -> bool:
        """Whether unread responses leave no room for this one; then `postpone` the call."""
        return False

    def postpone(self) -> None:
        """Pass the call to the service again once there is room for its response."""
        raise NotImplementedError

    def note_repetition(self) -> None:
        """Note that the request repeats an earlier one, for observers."""

    def lost(self) -> None:
        """Handle a lost connection: cancel the call, unless its caller can repeat it by id."""
        if self.received_id is None:
            self.cancel()

    def cancel(self) -> None:
        """Cancel the call: its caller cancelled it, or its deadline has passed."""
        self.cancelled = True
        if self.on_cancel is not None:
            self.on_cancel()


class Ended(Protocol):
    """Called once, at the end of a task."""

    def returned(self, value: object) -> None:
        """The coroutine returned this; called in the task's last step."""

    def done(self, task: asyncio.Future[object]) -> None:
        """The task is done in another way, or it is an ordinary task."""


class Begun(Protocol):
    """A coroutine that has suspended in its first step."""

    task: asyncio.Task[Any]
    """Runs the rest."""

    def then(self, ended: Ended) -> None:
        """Call one of the methods of `ended` at the end; in the turn of the first step only."""


class Counted(Protocol):
    """A queue that knows its length."""

    count: int


GoOn: TypeAlias = Callable[[IncomingCall, Any, float], object]
"""Goes on with a call: with what came of its callback, and the instant at which it began."""


class StoreClock(Protocol):
    """The clock by which the leases of a store's clients end."""

    @property
    def offset(self) -> float:
        """The offset from the loop's clock."""


class PlainStore(Protocol):
    """The state of a store that completes requests at once."""

    @property
    def ledger(self) -> Ledger | None:
        """Admits requests; None while the store is being read."""

    @property
    def clock(self) -> StoreClock | None:
        """None until the store has been read for the first time."""

    @property
    def next_expiry(self) -> float:
        """The instant on the clock from which the general path must look for ended leases."""


class PlainOnce(Protocol):
    """What makes a service exactly-once, if its store completes requests at once."""

    @property
    def state(self) -> PlainStore:
        """Its ledger admits requests. For an admitted request, `complete` or `executed` must
        follow before control returns to the event loop."""

    def complete(self, completion: Completion, record: ClientRecord) -> None:
        """Store the completion of an admitted request; its client has this record."""

    def executed(self, call: IncomingCall, *, is_over: bool) -> IncomingCall:
        """Return the execution of an admitted request, which answers this call at its end.

        Unless the request `is_over`, it counts as running.
        """


class PlainService(msgspec.Struct, eq=False, kw_only=True):
    """A service whose calls a connection may run itself; see `connection.plain_serving`.

    A call that the connection cannot end itself is passed to one of its `GoOn` functions.
    """

    callback: Callable[[Any, Any], Any]
    response: type[Any]
    concurrency: int
    waiting: Counted
    """The calls that wait."""
    returned: GoOn
    """Takes a call whose callback has returned this."""
    raised: GoOn
    """Takes a call whose callback has raised this."""
    begin: Callable[[Any, Coroutine[Any, Any, Any]], tuple[Any, GoOn]]
    """Runs the first step of the coroutine that a callback returned for this call; returns what
    came of it, and the function that takes both."""
    finished: Callable[[float], object]
    """Called after a call if other calls wait, or if the service is withdrawn."""
    held: Callable[[float], object]
    """Called with the seconds of a call that held the event loop for `holds_after` seconds."""
    holds_after: float
    once: PlainOnce | None = None
    """Decides about the requests of an exactly-once service; None for other services."""
    running: int = 0
    """Calls that run, or whose effect is not stored yet."""


class Offer(msgspec.Struct, frozen=True, eq=False):
    """A service that a node offers."""

    name: str
    """Absolute."""
    srv_type: ServiceType
    node: str
    """The fully qualified name of the node."""
    serve: Callable[[IncomingCall], None]
    """Takes each call; returns at once, and responds later."""
    mode: Mode = Mode.AT_MOST_ONCE
    join: bool = False
    """Whether other processes may offer the same name."""
    store_id: Callable[[], asyncio.Future[bytes]] | None = None
    """For exactly-once services: returns a future of the store's id. If reading the store failed,
    each further call reads it again."""
    observer: Observer | None = None
    """Gets a report of the start and the end of each call."""
    role: Role = Role.SUBMIT
    """The lowest role that may call."""
    plain: PlainService | None = None
    """The service, if connections may run its calls themselves."""


OnDone: TypeAlias = Callable[[Any, BaseException | None], object]
"""Called when a call ends: with the response and None, or with None and the error."""


class ProgramStatistics(msgspec.Struct, frozen=True):
    """What a program is, and what it says about its calls."""

    entry: RegistryEntry
    statistics: Statistics | None
    """None if the program offers nothing, and if there is a problem."""
    problem: str = ""
    """Why the program does not answer or has no statistics; "" if it offers nothing."""


OnMismatch: TypeAlias = Callable[[str], object]
"""Called on the event loop with the difference: `TYPE`, or the policy, such as `RELIABILITY`."""

Deliver: TypeAlias = Callable[[Body, int], object]
"""Called with each message and the number of the read that received it. Messages of one read have
the same number; for messages of this process it is 0."""


class TopicPublisher(Protocol):
    """The transport's part of a publisher: sends to the subscriptions of its topic."""

    def encode(self, message: Any) -> bytes:
        """Return the message as bytes for `publish`. Raises InvalidRequest."""

    @property
    def matched(self) -> int:
        """How many subscriptions get its messages."""

    @property
    def sent(self) -> int:
        """The number of messages so far."""

    @property
    def lost(self) -> int:
        """Messages that were dropped because a subscription does not read, one for each."""

    def publish(self, body: bytes) -> None:
        """Send a message to all matched subscriptions."""

    on_matched: Callable[[], object]
    """Called on the loop when the matched subscriptions have changed."""

    def forget_latched(self) -> None:
        """Forget the messages that are kept for later subscriptions."""

    def close(self) -> None:
        """End the publisher."""


class TopicSubscription(Protocol):
    """The transport's part of a subscription: receives from the publishers of its topic."""

    @property
    def decode(self) -> Callable[[Body], Any]:
        """Turns a delivered body into a message. Raises InvalidRequest."""

    @property
    def matched(self) -> int:
        """How many publishers send messages to it."""

    @property
    def lost(self) -> int:
        """Messages of these publishers that did not arrive."""

    on_matched: Callable[[], object]
    """Called on the loop when the matched publishers have changed."""

    def close(self) -> None:
        """End the subscription."""


class NativeTopics(Protocol):
    """The topics that a middleware itself has."""

    def create_publisher(
        self, named: TopicEndpoint, msg_type: Any, on_mismatch: OnMismatch | None
    ) -> TopicPublisher:
        """Create a native publisher. Raises TaskRpcError if the middleware cannot."""

    def create_subscription(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None,
    ) -> TopicSubscription:
        """Create a native subscription; `deliver(body, number)` gets the body as its publisher's
        `encode` returned it, or as the middleware encodes it: only `decode` reads it.
        """


def end_program(error: BaseException) -> None:
    """Raise SystemExit or KeyboardInterrupt; call it from the event loop, which then ends.

    In an asyncio protocol it must not be raised: uvloop swallows it there.
    """
    raise error
