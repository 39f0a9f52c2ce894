"""The interface between nodes and any transport: offer services, call them, list processes.

The layers above know only this interface, not TCP, memory or another middleware. It passes typed
messages; the transport encodes them.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import msgspec

from taskrpc.callinfo import CallInfo
from taskrpc.errors import TaskRpcError
from taskrpc.request_ids.ids import ReceivedId, RequestCounter, RequestId
from taskrpc.security.roles import Role
from taskrpc.transport.codec import ServiceType
from taskrpc.transport.discovery.entries import RegistryEntry
from taskrpc.wire.frames import Body
from taskrpc.wire.messages import ServiceEndpoint, TopicEndpoint

if TYPE_CHECKING:
    from concurrent.futures import Future

    from taskrpc.observer import Connections, Observer
    from taskrpc.wire.statistics import Statistics


class Mode(IntEnum):
    """What a server promises about repeated requests of one service."""

    AT_MOST_ONCE = 0
    IDEMPOTENT = 1
    EXACTLY_ONCE = 2


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


class SentCall(Protocol):
    """A call that was sent over a channel."""

    future: asyncio.Future[Any]
    """Yields the response, or an error. Code that cancels it must call `cancel` afterwards.
    asyncio's own class is used because awaiting it is fastest."""
    counter: RequestCounter | None
    """The counter that gave the call its sequence number; None without one."""
    sequence: int
    """The sequence number; 0 without one."""

    def cancel(self, future: asyncio.Future[Any] | None = None) -> None:
        """Cancel the call at the server, if its future was cancelled."""


OnDone: TypeAlias = Callable[[Any, BaseException | None], object]
"""Called when a call ends: with the response and None, or with None and the error."""


class WaitingThread(Protocol):
    """A call that a thread has sent and waits for."""

    def wait(self) -> Any:
        """Block until the call ends; return the response, or raise the error."""


class CallbackCall(Protocol):
    """A call that a thread has sent without waiting; it calls a function when it ends."""

    def cancel(self) -> None:
        """Cancel the call; the function is not called."""


class Unsent(Protocol):
    """A call that waits for its channel's connection."""

    def begin(self) -> None:
        """Send the request; must not raise."""


class Channel(Protocol):
    """A client's connection to one service; it survives reconnects. Deadlines: the loop's clock."""

    span_of: Callable[[], bytes] | None
    """Returns the trace span to send with a request, b"" for none."""
    on_refusal: Callable[[TaskRpcError], object]
    """Called once for each error with which an existing service refuses; logs it by default."""

    @property
    def offered(self) -> bool:
        """Whether a known process offers the service."""

    @property
    def mode(self) -> Mode:
        """What the server promised; known once connected."""

    @property
    def store_id(self) -> bytes:
        """The store of an exactly-once service, else b""; known once connected."""

    async def connect(self, deadline: float | None) -> None:
        """Find a server of the service and connect to it.

        Raises ServiceUnavailable at once if no process offers the service or none can be reached,
        and TypeMismatch, AuthenticationFailed or PermissionDenied if every server refuses.
        """

    def begin_when_connected(self, call: Unsent) -> None:
        """Begin a call once the channel is connected; waiting calls begin in order."""

    def forget_waiting(self, call: Unsent) -> None:
        """Remove a call that still waits for the connection."""

    async def wait(self, deadline: float | None) -> bool:
        """Wait until the service is available; False at the deadline or once closed."""

    @property
    def ready(self) -> bool:
        """Whether `send` can be used now."""

    @property
    def service_name(self) -> str:
        """The absolute name of the service; once connected, of the one that was reached."""

    def counter(self) -> RequestCounter:
        """Return the counter for the next request to the store of this exactly-once service."""

    def send(
        self, request: Any, deadline: float | None, request_id: RequestId | None = None
    ) -> SentCall | None:
        """Send a request; None if `connect` must be called first.

        Without `request_id`, a request to an exactly-once service gets the next one, and the caller
        must settle its sequence number in the end. A request without an id moves to another server
        if the server shuts down or withdraws the service before it begins the call.

        Raises InvalidRequest for a request that cannot be sent; its sequence number is settled.
        """

    def send_to_others(self, request: Any, on_response: Callable[[Any], object]) -> Future[None]:
        """Send the request to all other servers of the service, as ROS 2 does; from any thread.

        The event loop calls `on_response(response)` with each of their responses. The returned
        future is done when the request was sent to all of them.
        """

    def send_in_thread(self, request: Any, deadline: float | None) -> WaitingThread | None:
        """Send a request from another thread than the loop's; None if only the loop can send it.

        Raises InvalidRequest for a request that cannot be sent.
        """

    def send_in_thread_then(
        self, request: Any, deadline: float | None, on_done: OnDone
    ) -> CallbackCall | None:
        """Like `send_in_thread`; `on_done(response, error)` is called on the event loop."""

    def close(self) -> None:
        """Close the channel; calls in flight still get their responses."""


class ProgramStatistics(msgspec.Struct, frozen=True):
    """What a program is, and what it says about its calls."""

    entry: RegistryEntry
    statistics: Statistics | None
    """None if the program offers nothing, and if there is a problem."""
    problem: str = ""
    """Why the program does not answer or has no statistics; "" if it offers nothing."""


OnMismatch: TypeAlias = Callable[[str], object]
"""Called on the event loop with the difference: `TYPE`, `RELIABILITY` or `DURABILITY`."""

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


class Transport(Protocol):
    """The transport of a node. Nodes of one process and event loop may share one."""

    def hand_over(self, action: Callable[[], object]) -> None:
        """Run an action of another thread on the event loop.

        Until it has run, threads send nothing directly, because that would change the order.
        """

    def add_node(self, name: str) -> None:
        """Announce a node (fully qualified name)."""

    def remove_node(self, name: str) -> None:
        """Withdraw a node's announcement."""

    def offer(self, offer: Offer) -> None:
        """Accept calls for a service. Raises NameInUse if another process has the name."""

    def withdraw(self, offer: Offer) -> None:
        """Accept no more calls for a service; earlier calls may still get responses."""

    def add_server(self, server: ServiceEndpoint) -> None:
        """Announce another server of a service of this process; it gets no calls itself."""

    def remove_server(self, server: ServiceEndpoint) -> None:
        """Withdraw the announcement of `add_server`."""

    def replace(self, offer: Offer, by: Offer) -> None:
        """Pass new calls of a service to the offer `by`."""

    def channel(
        self, name: str, srv_type: ServiceType, node: str, *, otherwise: str = ""
    ) -> Channel:
        """Return a node's channel to a service; to `otherwise` if no process offers the first."""

    def create_publisher(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        role: Role,
        on_mismatch: OnMismatch | None = None,
    ) -> TopicPublisher:
        """Create a publisher; `role` is the lowest role of a subscriber.

        A subscription that does not match is logged, or reported to `on_mismatch`.
        """

    def create_subscription(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None = None,
    ) -> TopicSubscription:
        """Create a subscription; a publisher that does not match is logged or reported."""

    async def graph(self) -> list[RegistryEntry]:
        """Return the entries of all processes that this one can see."""

    async def statistics(self, timeout: float) -> list[ProgramStatistics]:
        """Return the statistics of every other process that this one can see.

        The processes measure their calls from now on, until this one disconnects.
        """

    async def definition(self, name: str) -> tuple[str, str]:
        """Return a service's type and the full text of its definition, from its server."""

    def traffic(self) -> tuple[str, Connections, Connections]:
        """Return this transport's id, and the counts of accepted and of dialled connections."""

    @property
    def address(self) -> str:
        """The address at which this process accepts calls; "" if it accepts none."""

    async def release(self) -> None:
        """Release the transport for one node; the last node's release closes it."""
