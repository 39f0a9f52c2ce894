"""The seam between nodes and any transport: offer services, call them, list processes.

Nothing above this module knows whether TCP frames, memory or another middleware lies below. The
seam passes typed messages: how they are encoded is the transport's business.
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


class Mode(IntEnum):
    """What a server promises about repeated requests of one service."""

    AT_MOST_ONCE = 0
    IDEMPOTENT = 1
    EXACTLY_ONCE = 2


class IncomingCall(CallInfo, eq=False):
    """A call that arrived: `request`, and exactly one of `reply` and `fail` to end it."""

    request: Any
    on_cancel: Callable[[], object] | None
    """Set by the service when it runs the call and can stop it."""
    started: bool
    """Set by the service when it runs the call; before, the call certainly did not run."""
    received_id: ReceivedId | None
    """The request id, None where the service is not exactly-once."""
    arrived: float
    """The instant when it was read, on the loop's clock."""

    def reply(self, response: Any, body: bytes | None = None) -> None:
        """Answer with a response message; `body` is the same, encoded by its `Codec`, if known.

        Raises InvalidRequest for a response that cannot be sent; the call is still open then.
        """
        raise NotImplementedError

    def reply_in_thread(self, body: bytes) -> bool:
        """Answer from another thread; False where only the event loop can."""
        return False

    def fail(self, error: TaskRpcError) -> None:
        """Answer with an error."""
        raise NotImplementedError

    @property
    def flow(self) -> Hashable:
        """The key in the fair queue: calls with the same key wait behind each other."""
        return self.principal or self.caller

    def must_wait(self) -> bool:
        """Whether there is no room for the response; then `postpone` the call."""
        return False

    def postpone(self) -> None:
        """Serve the call again once there is room for its response."""
        raise NotImplementedError

    def lost(self) -> None:
        """The way back to the caller is gone; one that counts its requests will come again."""
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
    """The offering node's fully qualified name."""
    serve: Callable[[IncomingCall], None]
    """Takes each call; returns at once, and answers later."""
    mode: Mode = Mode.AT_MOST_ONCE
    join: bool = False
    """Whether other processes may offer the same name."""
    store_id: Callable[[], asyncio.Future[bytes]] | None = None
    """For exactly-once services: the store's name, as soon as it is known. A store that could not
    be read is read again for whoever asks."""
    observer: Observer | None = None
    """Receives the begin and the end of each call."""
    role: Role = Role.SUBMIT
    """The lowest role that may call."""


class SentCall(Protocol):
    """A call that was sent over a channel."""

    future: asyncio.Future[Any]
    """Yields the response, or an error. Its class is asyncio's own, which awaits fastest; whoever
    cancels it must say so to `give_up`."""
    counter: RequestCounter | None
    """The counter that gave the call its sequence number, None without one."""
    sequence: int
    """The sequence number, 0 without one."""

    def give_up(self, future: asyncio.Future[Any] | None = None) -> None:
        """Cancel the call at the server, if the future was cancelled."""


OnDone: TypeAlias = Callable[[Any, BaseException | None], object]
"""Called at a call's end with its response and None, or with None and its error."""


class WaitingThread(Protocol):
    """A call that a thread has sent and waits for."""

    def wait(self) -> Any:
        """Sleep until there is a response, and return it; raises the call's error."""


class CallbackCall(Protocol):
    """A call that a thread has sent; a function is called at its end."""

    def give_up(self) -> None:
        """Cancel the call; the function is not called."""


class Unsent(Protocol):
    """A call that waits for its channel's connection."""

    def begin(self) -> None:
        """Send the request; must not raise."""


class Channel(Protocol):
    """A client's way to one service, kept open over reconnects."""

    span_of: Callable[[], bytes] | None
    """Returns the trace span to send with a request, b"" for none."""
    on_refusal: Callable[[TaskRpcError], object]
    """Called once for each error that keeps `wait` from an existing service; logs by default."""

    @property
    def offered(self) -> bool:
        """Whether a known process offers the service."""

    @property
    def mode(self) -> Mode:
        """What the server promised; known once connected."""

    @property
    def store_id(self) -> bytes:
        """The store of an exactly-once service; known once connected."""

    async def connect(self, deadline: float | None) -> None:
        """Find the service and reach it.

        Raises ServiceUnavailable at once when nobody offers it, TypeMismatch, or whatever stood in
        the way.
        """

    def begin_when_connected(self, call: Unsent) -> None:
        """Begin a call as soon as the channel is connected, in the order of these requests.

        So no call is sent before one that was made earlier and waits for the connection.
        """

    def forget_waiting(self, call: Unsent) -> None:
        """Remove a call that still waits for the connection."""

    async def wait(self, deadline: float | None) -> bool:
        """Wait until the service is there; False at the deadline or once closed."""

    @property
    def ready(self) -> bool:
        """Whether `send` can be used now."""

    @property
    def service_name(self) -> str:
        """Absolute; of what is called, once that is known."""

    def counter(self) -> RequestCounter:
        """Return the counter for the next request to the store of this exactly-once service."""

    def send(
        self, request: Any, deadline: float | None, request_id: RequestId | None = None
    ) -> SentCall | None:
        """Send a request; None where `connect` must come before, or a request id is needed.

        A call that the server certainly did not begin, since it ends or withdrew the service, moves
        to another server unseen.

        Raises InvalidRequest for a request that cannot be sent.
        """

    def send_to_others(self, request: Any, answered: Callable[[Any], object]) -> Future[None]:
        """Have all other servers of the name run the request, too: in ROS 2 each of them does.

        `answered(response)` is called, on the loop's thread, with each of their responses. What is
        returned is done once the request was sent to all of them.
        """

    def send_next(self, request: Any, deadline: float | None) -> SentCall | None:
        """Send a request to an exactly-once service with the next request id, as `send` does.

        The caller must settle its sequence number in the end.
        """

    def send_in_thread(self, request: Any, deadline: float | None) -> WaitingThread | None:
        """Send a request from another thread than the loop's; None where only the loop can.

        Raises InvalidRequest for a request that cannot be sent.
        """

    def send_in_thread_then(
        self, request: Any, deadline: float | None, tell: OnDone
    ) -> CallbackCall | None:
        """Like `send_in_thread`; `tell(response, error)` is called on the event loop."""

    def close(self) -> None:
        """Forget the service; calls in flight still get their answers."""


OnMismatch: TypeAlias = Callable[[str], object]
"""Called on the event loop with what differs: `TYPE`, `RELIABILITY` or `DURABILITY`."""

Deliver: TypeAlias = Callable[[Body, int], object]
"""Gets each message and a number, which messages of one read share. The number is 0 for messages
of this process."""


class TopicPublisher(Protocol):
    """A publisher's way to the subscriptions of its topic."""

    def encode(self, message: Any) -> bytes:
        """What `publish` takes. Raises InvalidRequest."""

    @property
    def matched(self) -> int:
        """How many subscriptions get its messages."""

    @property
    def sent(self) -> int:
        """Messages so far."""

    @property
    def lost(self) -> int:
        """Messages that were dropped for subscriptions that do not read, counted for each."""

    def publish(self, body: bytes) -> None:
        """Send a message to all of them."""

    on_matched: Callable[[], object]
    """Called on the loop when other subscriptions match."""

    def forget_latched(self) -> None:
        """Forget the messages that are kept for later subscriptions."""

    def close(self) -> None:
        """Publish no more."""


class TopicSubscription(Protocol):
    """A subscription's way to the publishers of its topic."""

    @property
    def decode(self) -> Callable[[Body], Any]:
        """Makes what was delivered a message. Raises InvalidRequest."""

    @property
    def matched(self) -> int:
        """How many publishers send messages to it."""

    @property
    def lost(self) -> int:
        """Messages of these publishers that did not arrive."""

    on_matched: Callable[[], object]
    """Called on the loop when other publishers match."""

    def close(self) -> None:
        """End the subscription."""


class Transport(Protocol):
    """The transport of a node. Nodes of one process and event loop may share one."""

    def hand_over(self, action: Callable[[], object]) -> None:
        """Run an action of another thread on the event loop.

        Until it has run, other threads send nothing themselves, so that the order is kept.
        """

    def add_node(self, name: str) -> None:
        """Announce a node (fully qualified name)."""

    def remove_node(self, name: str) -> None:
        """Withdraw a node's announcement."""

    def offer(self, offer: Offer) -> None:
        """Take calls for a service. Raises NameInUse when another process has the name."""

    def withdraw(self, offer: Offer) -> None:
        """Stop taking calls for a service; those that came before may still be answered."""

    def add_server(self, server: ServiceEndpoint) -> None:
        """Announce another server of a service of this process; it takes no calls itself."""

    def remove_server(self, server: ServiceEndpoint) -> None:
        """Withdraw such an announcement."""

    def replace(self, offer: Offer, by: Offer) -> None:
        """Take the calls that come from now on for another offer of the same service."""

    def channel(
        self, name: str, srv_type: ServiceType, node: str, *, otherwise: str = ""
    ) -> Channel:
        """A way to call a service for a node; the service `otherwise` where nobody offers it."""

    def create_publisher(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        role: Role,
        on_mismatch: OnMismatch | None = None,
    ) -> TopicPublisher:
        """A way to publish for a node; `role` is the least that a subscriber must be.

        Subscriptions that do not match are logged, unless `on_mismatch` is to be told.
        """

    def create_subscription(
        self,
        named: TopicEndpoint,
        msg_type: Any,
        deliver: Deliver,
        on_mismatch: OnMismatch | None = None,
    ) -> TopicSubscription:
        """A way to subscribe for a node."""

    async def graph(self) -> list[RegistryEntry]:
        """Every process that can be seen: its nodes, and what they have."""

    async def definition(self, name: str) -> tuple[str, str]:
        """A service's type and the full text of its definition, from the server that has it."""

    def traffic(self) -> tuple[str, Connections, Connections]:
        """A name for this transport's sockets, and what they have accepted and dialled."""

    @property
    def address(self) -> str:
        """Where this process takes calls, "" while it does not."""

    async def release(self) -> None:
        """Give up this holder's share; the last one closes everything."""
