"""Observers: objects that a node notifies of its calls; and the counts of a node."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import msgspec

from taskrpc.core.callinfo import CallInfo
from taskrpc.errors import Code

log = logging.getLogger("taskrpc.observer")

_Result = TypeVar("_Result")


class Connections(msgspec.Struct):
    """Counts of connections, and of the bytes that they carried."""

    opened: int = 0
    open: int = 0
    ended: dict[str, int] = {}
    """How many ended, by the name of the error; "" for those that ended without an error."""
    received: int = 0
    """Bytes, without what TLS adds."""
    sent: int = 0
    accounts: dict[str, int] = {}
    """How many are open, by the account of the caller; callers without an account do not count."""
    failed_lookups: dict[str, tuple[str, bool]] = {}
    """The last service that each account did not find: its name, and whether the server has this
    name with another type."""


class DeduplicationStatus(msgspec.Struct, frozen=True):
    """The requests of an exactly-once service, and what its ledger remembers."""

    requests: dict[str, int]
    """How many there were, by verdict: `new`, `attach` (a repetition while the request ran), `done`
    (answered from the store), `stale` (the client was forgotten), `reused` (another request had its
    id), `full` (refused for lack of memory)."""
    clients: int
    """How many clients are remembered, by all services of the same store."""
    bytes: int
    """Memory that these clients take."""


class ServiceStatus(msgspec.Struct, frozen=True):
    """The load of one service."""

    name: str
    running: int
    waiting: int
    """Calls in the queue."""
    once: DeduplicationStatus | None = None
    """Deduplication; None if the service is not exactly-once."""


class TopicStatus(msgspec.Struct):
    """Counts of one node's publishers and subscriptions of a topic since the node started."""

    published: int = 0
    """Messages."""
    received: int = 0
    lost_sending: int = 0
    """Messages not sent because a subscription does not read, for each subscription."""
    lost_coming: int = 0
    """Messages that were published for our subscriptions and did not arrive."""
    lost_waiting: int = 0
    """Messages that arrived and were dropped because a callback was too slow."""
    subscriptions: int = 0
    """Subscriptions that receive from our publishers now."""
    publishers: int = 0
    """Publishers from which our subscriptions receive now."""


class NodeStatus(msgspec.Struct, frozen=True):
    """The present load of a node, and its counts since it started."""

    services: tuple[ServiceStatus, ...]
    retries: dict[str, int]
    """How often the node's clients have repeated a call, by service."""
    endpoint: str
    """Identifies the socket; the nodes of one program share it and the next two counts."""
    accepted: Connections
    """The connections that other programs have made to this one."""
    dialled: Connections
    """The connections that this program has made."""
    topics: dict[str, TopicStatus] = {}
    """By absolute name."""


class ObservedNode(Protocol):
    """The part of a node that its observer may use."""

    def get_fully_qualified_name(self) -> str:
        """`/namespace/name`."""

    def status(self) -> NodeStatus:
        """Return the present load of the node, and its counts."""


class Outgoing(Protocol):
    """An observer's object for one call that a client makes."""

    @property
    def span(self) -> bytes:
        """The trace context for the server: 16 bytes of trace id, 8 of span id, 1 of flags.

        As in W3C's trace context; empty for none.
        """

    def ended(self, code: Code, seconds: float) -> None:
        """The call has ended; it took `seconds`, including retries."""


class Observer:
    """The base class of observers: override the methods you need, pass it to `Node(observer=...)`.

    All methods do nothing here. The event loop calls them between its other work, so they must be
    quick. Their exceptions are logged and do not affect the call. Nodes without an observer pay
    nothing for this.
    """

    def node_started(self, node: ObservedNode) -> None:
        """A node joined the network; its `status()` may be called until `node_ended`."""

    def node_ended(self, node: ObservedNode) -> None:
        """A node is about to leave the network."""

    def call_began(self, call: CallInfo) -> None:
        """A call arrived at one of the node's services; it may have to wait in the queue."""

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """A call gets its response; `call_ended` follows."""

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A call has ended, `seconds` after it arrived.

        `code` is `Code.OK`, or the code of the error for the caller; `Code.CANCELLED` if the caller
        has disconnected. For a request that could not be decoded, only this method is called.
        """

    def request_began(self, service: str) -> Outgoing | None:
        """One of the node's clients makes a call; the returned object is notified of its end."""
        return None

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """One of the node's clients has made a call, which took `seconds`, including retries."""


class Observers(Observer):
    """Notifies several observers, in this order: `Node(observer=Observers(metrics, tracing))`."""

    def __init__(self, *observers: Observer) -> None:
        self._observers = observers

    def node_started(self, node: ObservedNode) -> None:
        """A node joined the network."""
        for each in self._observers:
            call_observer(each.node_started, node)

    def node_ended(self, node: ObservedNode) -> None:
        """A node is about to leave the network."""
        for each in self._observers:
            call_observer(each.node_ended, node)

    def call_began(self, call: CallInfo) -> None:
        """A call arrived."""
        for each in self._observers:
            call_observer(each.call_began, call)

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """A call gets its response."""
        for each in self._observers:
            call_observer(each.call_answered, call, response)

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A call has ended."""
        for each in self._observers:
            call_observer(each.call_ended, call, code, seconds)

    def request_began(self, service: str) -> Outgoing | None:
        """A client makes a call; the server knows the span of the first observer that has one."""
        began = [call_observer(each.request_began, service) for each in self._observers]
        return _Several([each for each in began if each is not None])

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """A client has made a call."""
        for each in self._observers:
            call_observer(each.request_ended, service, code, seconds)


class _Several:
    """The objects of several observers for one call."""

    def __init__(self, began: list[Outgoing]) -> None:
        self._began = began
        self.span = next((each.span for each in began if each.span), b"")

    def ended(self, code: Code, seconds: float) -> None:
        for each in self._began:
            call_observer(each.ended, code, seconds)


def call_observer(method: Callable[..., _Result], *arguments: Any) -> _Result | None:
    """Call a method of an observer; if it raises, log the exception and return None."""
    try:
        return method(*arguments)
    except Exception:
        log.exception("an observer failed")
        return None
