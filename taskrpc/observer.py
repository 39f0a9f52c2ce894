"""What operators want to know: the seam for metrics, traces and logs, and what a node counts."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import msgspec

from taskrpc.callinfo import CallInfo
from taskrpc.errors import Code

log = logging.getLogger("taskrpc.observer")

_Answer = TypeVar("_Answer")


class Connections(msgspec.Struct):
    """What became of the connections that one side has made, and what went over them."""

    opened: int = 0
    open: int = 0
    ended: dict[str, int] = {}
    """How many ended, by the name of the error, "" where nothing was wrong."""
    received: int = 0
    """Bytes, without what TLS adds."""
    sent: int = 0


class DeduplicationStatus(msgspec.Struct, frozen=True):
    """What an exactly-once service was asked, and what its store remembers."""

    requests: dict[str, int]
    """How many there were, by what was known of them: `new`, `attach` (it runs), `done` (answered
    from the store), `stale` (its client was forgotten), `reused` (another one had its number),
    `full` (no room for it)."""
    clients: int
    """How many are remembered, with those of other services of the same store."""
    bytes: int
    """What that takes."""


class ServiceStatus(msgspec.Struct, frozen=True):
    """How much one service has to do."""

    name: str
    running: int
    waiting: int
    """Calls that wait for their turn."""
    once: DeduplicationStatus | None = None
    """For an exactly-once service."""


class TopicStatus(msgspec.Struct):
    """What one node's publishers and subscriptions of a topic have done since the node started."""

    published: int = 0
    """Messages."""
    received: int = 0
    lost_sending: int = 0
    """What our publishers could not send, since a subscription did not read; for each of them."""
    lost_coming: int = 0
    """What was published for our subscriptions and did not come."""
    lost_waiting: int = 0
    """What came and was dropped, since a callback was behind."""
    subscriptions: int = 0
    """Those that get messages of our publishers now."""
    publishers: int = 0
    """Those that our subscriptions get messages of now."""


class NodeStatus(msgspec.Struct, frozen=True):
    """What a node has to do now, and what it has done since it started."""

    services: tuple[ServiceStatus, ...]
    retries: dict[str, int]
    """How often the node's clients have repeated a call, by service."""
    endpoint: str
    """Tells sockets apart: the nodes of one program share theirs, and the two counts below."""
    accepted: Connections
    """The connections on which this program is called."""
    dialled: Connections
    """The connections on which it calls."""
    topics: dict[str, TopicStatus] = {}
    """By absolute name."""


class ObservedNode(Protocol):
    """The part of a node that its observer may use."""

    def get_fully_qualified_name(self) -> str:
        """`/namespace/name`."""

    def status(self) -> NodeStatus:
        """What the node has to do now."""


class Outgoing(Protocol):
    """What an observer keeps of a call that a client makes."""

    @property
    def span(self) -> bytes:
        """What the server shall know: 16 bytes of the trace's id, 8 of the span's, 1 of flags.

        As W3C's trace context has them; empty for nothing.
        """

    def ended(self, code: Code, seconds: float) -> None:
        """The client has made the call, which took `seconds` with all retries."""


class Observer:
    """Derive from it, override what you want to know, and give it to `Node(observer=...)`.

    All methods do nothing here. They are called on the event loop in the midst of the work, so they
    must be quick; what they raise is logged and does the call no harm. Nodes without an observer
    pay nothing for this.
    """

    def node_started(self, node: ObservedNode) -> None:
        """A node joined the network; its `status()` may be asked until `node_ended`."""

    def node_ended(self, node: ObservedNode) -> None:
        """A node is about to leave the network."""

    def call_began(self, call: CallInfo) -> None:
        """A call arrived at one of the node's services; it may have to wait for its turn."""

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """A call gets its response; `call_ended` follows."""

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A call has its answer, `seconds` after it arrived.

        `code` is `Code.OK`, or that of the error which the caller gets, `Code.CANCELLED` where the
        caller has gone. A request that could not be decoded ends without having begun.
        """

    def request_began(self, service: str) -> Outgoing | None:
        """One of the node's clients makes a call; what is returned hears of its end."""
        return None

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """One of the node's clients has made a call, which took `seconds` with all retries."""


class Observers(Observer):
    """Tells several observers, in this order: `Node(observer=Observers(metrics, tracing))`."""

    def __init__(self, *observers: Observer) -> None:
        self._observers = observers

    def node_started(self, node: ObservedNode) -> None:
        """A node joined the network."""
        for each in self._observers:
            told(each.node_started, node)

    def node_ended(self, node: ObservedNode) -> None:
        """A node is about to leave the network."""
        for each in self._observers:
            told(each.node_ended, node)

    def call_began(self, call: CallInfo) -> None:
        """A call arrived."""
        for each in self._observers:
            told(each.call_began, call)

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """A call gets its response."""
        for each in self._observers:
            told(each.call_answered, call, response)

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """A call has its answer."""
        for each in self._observers:
            told(each.call_ended, call, code, seconds)

    def request_began(self, service: str) -> Outgoing | None:
        """A client makes a call; the server knows the span of the first observer that has one."""
        began = [told(each.request_began, service) for each in self._observers]
        return _Several([each for each in began if each is not None])

    def request_ended(self, service: str, code: Code, seconds: float) -> None:
        """A client has made a call."""
        for each in self._observers:
            told(each.request_ended, service, code, seconds)


class _Several:
    """One call, and what several observers keep of it."""

    def __init__(self, began: list[Outgoing]) -> None:
        self._began = began
        self.span = next((each.span for each in began if each.span), b"")

    def ended(self, code: Code, seconds: float) -> None:
        for each in self._began:
            told(each.ended, code, seconds)


def told(tell: Callable[..., _Answer], *what: Any) -> _Answer | None:
    """Tell an observer, and survive what it raises: None then."""
    try:
        return tell(*what)
    except Exception:
        log.exception("an observer failed")
        return None
