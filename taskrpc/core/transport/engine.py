"""The interface that each middleware implements: presence, datagrams, native services and topics.

A middleware is software that carries messages between programs, such as Zenoh or ROS 2. Its engine
is a thin adapter. `taskrpc.core.transport.tunnel` makes connections between taskrpc programs out
of the engine's datagrams. So deadlines, cancellation, typed errors and exactly-once work as over
TCP.

Most middlewares have services and topics of their own, called native. They connect taskrpc programs
with foreign programs: all programs of the middleware that are not taskrpc's. A `NativeEngine` uses
them. Without them, topics travel over the connections too.

All methods are called on the event loop, and must not block. An engine with threads passes what it
receives to the loop with `taskrpc.core.transport.tunnel.handoff.Handoff`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import msgspec

from taskrpc.core.transport.base import NativeTopics, OnDone
from taskrpc.core.transport.codec import ServiceType
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.errors import TaskRpcError


class ForeignServer(msgspec.Struct, frozen=True):
    """A native server of a service in a foreign program."""

    type_name: str
    """As in `std_srvs/srv/Trigger`."""
    type_hash: str
    """The RIHS01 hash of the service, "" if the engine does not know it."""
    node: str
    """The fully qualified name of the server's node."""


class EngineEvents(Protocol):
    """What an engine reports; it calls these methods on the event loop, never inside `send`."""

    def received(self, datagram: bytes) -> None:
        """Handle a datagram that was sent to this program's address; garbage is ignored."""

    def program_seen(self, address: str, entry: bytes) -> None:
        """Note that the taskrpc program at an address is there, and the entry that it announces."""

    def program_gone(self, address: str) -> None:
        """Note that the taskrpc program at an address has left, or cannot be reached any more."""

    def foreign_changed(self) -> None:
        """Note that `foreign_entries` or `foreign_servers` return something else now."""

    def interrupted(self, reason: str) -> None:
        """Note that no program can be reached now, for example because a router is gone.

        All connections end. Programs count as gone until `program_seen` reports them again.
        """

    def resumed(self) -> None:
        """Note that the interruption is over."""


class NativeReply(Protocol):
    """The way back for the response to one native request."""

    caller: str
    """The name of the caller for logs, "" if it is unknown."""

    def reply(self, response: Any) -> None:
        """Send the response message."""

    def fail(self, error: TaskRpcError) -> None:
        """Tell the caller, as far as the middleware can, that there will be no response."""


class Closable(Protocol):
    """Something that lasts until it is closed."""

    def close(self) -> None:
        """End it."""


class Cancelable(Protocol):
    """A native call without a response so far."""

    def cancel(self) -> None:
        """Forget the call: `on_done` is not called any more."""


class Engine(Protocol):
    """One program's access to a middleware."""

    name: str
    """The middleware as errors name it, such as `Zenoh`."""
    address: str
    """The address to which other programs send this program's datagrams, "" before `open`."""
    discovery_ends: float
    """The instant on the loop's clock until which `open` may have missed a program, 0 if never."""

    async def open(self, events: EngineEvents) -> None:
        """Join the middleware. Raises TaskRpcError with what the user can do.

        Programs that are there already should be reported before it returns.
        """

    def send(self, address: str, datagram: bytes) -> None:
        """Send a datagram of at most 64 KiB and a header to the program at an address.

        Two datagrams to one address keep their order. A datagram may get lost without notice:
        connections detect it and end. An address may come from a stranger: the engine must not send
        anything outside its own names.
        """

    def announce(self, entry: bytes) -> None:
        """Show this program to all others, also to later ones, with this entry.

        A later announcement replaces it. If this program ends, or can no longer be reached, the
        others get `program_gone`.
        """

    def close(self) -> None:
        """Leave the middleware; no event follows. May be called without `open`, and twice."""


@runtime_checkable
class NativeEngine(Engine, NativeTopics, Protocol):
    """An engine whose middleware has services and topics of its own."""

    def update(self, change: EntryChange) -> None:
        """Show a node, service or client of this program in the middleware's own graph."""

    def foreign_entries(self) -> list[RegistryEntry]:
        """Return the foreign nodes with their services and topics, for `Node.graph`.

        Commands print the names: leave out names with control characters.
        """

    def foreign_servers(self, service: str) -> list[ForeignServer]:
        """Return the native servers of a service in foreign programs; the name is absolute."""

    def serve(
        self,
        named: ServiceEndpoint,
        srv_type: ServiceType,
        serve: Callable[[Any, NativeReply], None],
    ) -> Closable:
        """Offer a service to foreign programs: call `serve(request, reply)` for each request.

        Raises TaskRpcError if the middleware cannot offer it.
        """

    def call(
        self, service: str, srv_type: ServiceType, request: Any, on_done: OnDone
    ) -> Cancelable:
        """Call a native service; `on_done(response, error)` is called later, at most once.

        The error is a TaskRpcError: InvalidRequest for a request that cannot be sent,
        OutcomeUnknown if the server went. The call has no deadline; the tunnel cancels it.
        """
