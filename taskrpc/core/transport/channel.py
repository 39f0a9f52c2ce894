"""A client's channel to one service: finds a server, resolves the service, and reconnects."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from taskrpc.core.request_ids.ids import RequestCounter, RequestCounters, RequestId, with_request_id
from taskrpc.core.transport.base import Mode, OnDone
from taskrpc.core.transport.chance import chance_of
from taskrpc.core.transport.codec import ServiceType, codec_of
from taskrpc.core.transport.connection.client_side import CallingConnection, OpenCall
from taskrpc.core.transport.connection.client_threads import (
    CallbackWaiter,
    ThreadedConnection,
    Waiter,
)
from taskrpc.core.transport.connection.dialling import Dialler, why_silent
from taskrpc.core.transport.discovery.availability import Availability
from taskrpc.core.transport.network import Address, Network, no_server
from taskrpc.core.wire.frames import Flag
from taskrpc.core.wire.messages import Resolve, ServiceEndpoint
from taskrpc.errors import (
    AuthenticationFailed,
    InvalidRequest,
    PermissionDenied,
    ServiceUnavailable,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.retry import reconnect_delay

if TYPE_CHECKING:
    from concurrent.futures import Future

log = logging.getLogger("taskrpc.client")

RESOLVE_TIMEOUT = 3.0
"""Seconds."""
_EXACTLY_ONCE, _TRACED = int(Flag.EXACTLY_ONCE), int(Flag.TRACED)


class Unsent(Protocol):
    """A call that waits for its channel's connection."""

    def begin(self) -> None:
        """Send the request; must not raise."""


class ChannelContext(Protocol):
    """The objects that all channels of one endpoint share."""

    loop: asyncio.AbstractEventLoop
    network: Network
    availability: Availability
    counters: RequestCounters

    @property
    def dialler(self) -> Dialler:
        """The connections to other processes."""

    def channel_closed(self, named: ServiceEndpoint) -> None:
        """Count a channel that was closed."""


class RemoteChannel:
    """A client's channel to one service; it survives reconnects. Deadlines: the loop's clock."""

    def __init__(
        self,
        endpoint: ChannelContext,
        named: ServiceEndpoint,
        srv_type: ServiceType,
        *,
        otherwise: Sequence[str] = (),
    ) -> None:
        self.mode = Mode.AT_MOST_ONCE
        """What the server promised; known once connected."""
        self.store_id = b""
        """The store of an exactly-once service, else b""; known once connected."""
        self.span_of: Callable[[], bytes] | None = None
        """Returns the trace span to send with a request, b"" for none."""
        self._counter: RequestCounter | None = None
        """Counts the requests to the present store; None before the first of them."""
        self._endpoint = endpoint
        self._named = named
        self._names = (named.name, *otherwise)
        self._shown = " or ".join(self._names)
        """The names as errors show them."""
        self._reached = named.name
        """The name that the present server offers."""
        self._encode = codec_of(srv_type.Request).encode
        self._decode = codec_of(srv_type.Response).decode
        self._connection: CallingConnection | None = None
        self._method = 0
        """The method id of the service on `_connection`."""
        self._epoch = 0
        """The connection's epoch in which `_method` is valid."""
        self._connecting: asyncio.Task[None] | None = None
        self._moves: set[asyncio.Task[None]] = set()
        """Tasks that send refused calls to another server."""
        self._waiting: dict[Unsent, None] = {}
        """Calls that wait for the connection, in the order in which they were made."""
        self._mark = endpoint.availability.mark()
        self._has_addresses = False
        """Whether the last search found the address of a possible server."""
        self._closed = False
        self._last_refusal = ""
        """The last error that was passed to `on_refusal`."""
        self.on_refusal: Callable[[TaskRpcError], object] = self._warn
        """Called when a server refuses the client; not again while the error stays the same."""

    @property
    def ready(self) -> bool:
        """Whether `send` can be used now."""
        connection = self._connection
        return connection is not None and connection.epoch == self._epoch

    @property
    def offered(self) -> bool:
        """Whether a known process offers the service with this client's definition."""
        if self.ready or self._closed:
            return not self._closed
        fits = ("", self._named.type_hash)
        return any(each.surely_offers and each.type_hash in fits for _, each in self._locate())

    @property
    def service_name(self) -> str:
        """The absolute name; with two names, the one that a server offers, once it is known."""
        return self._reached

    def counter(self) -> RequestCounter:
        """Return the counter for the next request to the store."""
        return self._endpoint.counters.counter(self.store_id)

    def send(
        self,
        request: Any,
        deadline: float | None,
        request_id: RequestId | None = None,
        left: int = 0,
    ) -> OpenCall | None:
        """Send a request; None if `connect` must be called first.

        `left` is the milliseconds until the deadline, if the caller knows them; see
        `CallingConnection.begin`.

        Without `request_id`, a request to an exactly-once service gets the next one, and the caller
        must settle its sequence number in the end. A request without an id moves to another server
        if the server shuts down or withdraws the service before it begins the call.

        Raises InvalidRequest for a request that cannot be sent; its sequence number is settled.
        """
        connection = self._connection
        if connection is None or connection.epoch != self._epoch:
            return None
        body, flags, counter, sequence = self._encode(request), 0, None, 0
        move: Callable[[OpenCall], object] | None = self._move
        if request_id is not None or self.store_id:
            # Another server may have another store: a request with an id is never moved there.
            flags, move = _EXACTLY_ONCE, None
            if request_id is not None:
                body = with_request_id(request_id, body)
            else:
                counter = self._counter
                if counter is None or counter.is_retired:
                    counter = self._counter = self.counter()
                sequence, body = counter.take_for(body)
        if self.span_of is not None and (span := self.span_of()):
            body, flags = span + body, flags | _TRACED
        future: asyncio.Future[Any] = asyncio.Future(loop=self._endpoint.loop)
        call = OpenCall(
            future,
            connection,
            self._decode,
            deadline,
            self._method,
            body,
            move,
            flags,
            counter=counter,
            sequence=sequence,
        )
        try:
            connection.begin(call, left)
        except InvalidRequest:
            if counter is not None:
                counter.settle(sequence)
            raise
        return call

    def send_in_thread(self, request: Any, deadline: float | None, left: int = 0) -> Waiter | None:
        """Send a request from another thread; None if only the event loop can send it.

        The call may have ended when this returns. `left` as in `send`. Raises InvalidRequest for a
        request that cannot be sent.
        """
        waiter = Waiter()
        return waiter if self._begin_in_thread(waiter, request, deadline, left) else None

    def send_in_thread_then(
        self, request: Any, deadline: float | None, on_done: OnDone, left: int = 0
    ) -> CallbackWaiter | None:
        """Like `send_in_thread`; `on_done(response, error)` is called on the event loop."""
        waiter = CallbackWaiter(on_done)
        return waiter if self._begin_in_thread(waiter, request, deadline, left) else None

    def _begin_in_thread(
        self, waiter: Waiter | CallbackWaiter, request: Any, deadline: float | None, left: int
    ) -> bool:
        # The event loop may connect to another server at the same time; there, the same method id
        # means another service. So read the connection before and after the method.
        connection, method = self._connection, self._method
        if not isinstance(connection, ThreadedConnection) or connection.epoch != self._epoch:
            return False
        if connection is not self._connection or self.store_id:
            return False
        body, decode, move = self._encode(request), self._decode, self._move
        call = OpenCall(waiter, connection, decode, deadline, method, body, move)
        waiter.call = call
        if isinstance(waiter, Waiter):
            return connection.call_in_thread(call, left)
        return connection.begin_in_thread(call, left)

    def refuse_if_closed(self) -> None:
        """Raise TaskRpcError once the channel is closed."""
        if self._closed:
            raise TaskRpcError(f"the client of {self._shown} is destroyed")

    async def connect(self, deadline: float | None) -> None:
        """Find a server of the service and connect to it.

        Raises ServiceUnavailable at once if no process offers the service or none can be reached;
        while the network still discovers programs, it waits for one that offers the service. Raises
        TypeMismatch, AuthenticationFailed or PermissionDenied if every server refuses.
        """
        while not self.ready:
            self.refuse_if_closed()
            connecting = self._connecting
            if connecting is None or connecting.done():
                self._connecting = connecting = asyncio.ensure_future(self._connect())
                connecting.add_done_callback(_retrieved)
            left = None if deadline is None else max(0.0, deadline - self._endpoint.loop.time())
            # Several calls may wait for this task: a timeout of one must not cancel it.
            done, _ = await asyncio.wait((connecting,), timeout=left)
            if not done:
                if not (addresses := self._locate()):
                    raise no_server(self._endpoint.network, self._shown)
                silent = next(filter(None, (why_silent(each) for _, each in addresses)), "")
                reason = f": {silent}" if silent else " in time"
                raise ServiceUnavailable(f"{self._shown} could not be reached{reason}")
            if not connecting.cancelled():
                connecting.result()

    def begin_when_connected(self, call: Unsent) -> None:
        """Begin the call as soon as the channel is connected, after the calls that wait already."""
        self._waiting[call] = None

    def forget_waiting(self, call: Unsent) -> None:
        """Do not begin the call if it still waits for the connection."""
        self._waiting.pop(call, None)

    async def wait(self, deadline: float | None) -> bool:
        """Wait until the channel is connected; False at the deadline, or once it is closed."""
        failures = 0
        while not self._closed:
            try:
                await self.connect(deadline)
                return True
            except ServiceUnavailable as error:
                log.debug("%s", error, extra={"service": self._named.name})
            except TaskRpcError as error:
                if self._last_refusal != str(error) and not self._closed:
                    self._last_refusal = str(error)
                    self.on_refusal(error)
            left = None if deadline is None else deadline - self._endpoint.loop.time()
            if left is not None and left <= 0:
                return False
            failures = await self._wait_for_change(failures, left)
        return False

    def close(self) -> None:
        """Close the channel; calls that wait for a connection fail."""
        if self._closed:
            return
        self._closed = True
        self._connection = None
        if self._connecting is not None:
            self._connecting.cancel()
        self._endpoint.channel_closed(self._named)
        # Calls that still wait for the service must fail.
        self._endpoint.availability.notify()

    def _warn(self, error: TaskRpcError) -> None:
        log.warning("%s", error, extra={"service": self._named.name})

    def _locate(self) -> list[tuple[str, Address]]:
        """The addresses of possible servers, each with the name to resolve there."""
        locate = self._endpoint.network.locate
        return [(name, each) for name in self._names for each in locate(name)]

    async def _wait_for_change(self, failures: int, left: float | None) -> int:
        """Wait until another attempt may succeed; returns the number of failures in a row."""
        # A server with a known address gives no notice when it starts: retry at growing intervals.
        chance = chance_of(self._endpoint.loop).random()
        delay = reconnect_delay(failures, chance) if self._has_addresses else None
        limits = [each for each in (left, delay) if each is not None]
        changed = await self._endpoint.availability.wait(self._mark, min(limits, default=None))
        return 0 if changed else failures + 1

    async def _connect(self) -> None:
        tried: set[tuple[str, str]] = set()
        problem, refusal = no_server(self._endpoint.network, self._shown), None
        # Another server may have appeared while one that is gone was tried.
        while addresses := await self._untried(tried):
            for name, address in addresses:
                tried.add((name, address.text))
                try:
                    return await self._reach(name, address)
                except (TypeMismatch, AuthenticationFailed, PermissionDenied) as error:
                    refusal = refusal or error
                except ServiceUnavailable:
                    pass  # the peer offers other services only
                except TaskRpcError as error:
                    problem = ServiceUnavailable(f"{self._shown} could not be reached: {error}")
        raise refusal or problem

    async def _untried(self, tried: set[tuple[str, str]]) -> list[tuple[str, Address]]:
        """The addresses of possible servers that are not among the `tried` names and places."""
        addresses = await self._find()
        self._has_addresses = bool(addresses)
        return [(name, each) for name, each in addresses if (name, each.text) not in tried]

    async def _find(self) -> list[tuple[str, Address]]:
        """Locate servers; while the network discovers programs, wait for the first server."""
        endpoint = self._endpoint
        while True:
            self._mark = endpoint.availability.mark()
            addresses = self._locate()
            left = endpoint.network.discovery_ends - endpoint.loop.time()
            if addresses or left <= 0:
                return addresses
            await endpoint.availability.wait(self._mark, left)

    async def _reach(self, name: str, address: Address) -> None:
        endpoint = self._endpoint
        connection = await endpoint.dialler.connection(address, None)
        # Read the epoch first: if it changes before the response arrives, the method id is invalid.
        epoch = connection.epoch
        request = Resolve(name, self._named.type_hash, self._named.node)
        resolving = connection.resolve(request, endpoint.loop.time() + RESOLVE_TIMEOUT)
        resolved = await resolving.future
        self._connection = None  # other threads must not see the new method with the old connection
        self._method, self._epoch, self._reached = resolved.method, epoch, name
        known = resolved.mode in tuple(Mode)
        self.mode = Mode(resolved.mode) if known else Mode.AT_MOST_ONCE
        self.store_id = resolved.store_id if self.mode is Mode.EXACTLY_ONCE else b""
        self._counter = None
        self._connection = connection
        if self.ready:
            waiting, self._waiting = self._waiting, {}
            for call in waiting:
                call.begin()

    def send_to_others(self, request: Any, on_response: Callable[[Any], object]) -> Future[None]:
        """Send the request to all other servers of the service, as ROS 2 does; from any thread.

        The event loop calls `on_response(response)` with each of their responses. The returned
        future is done when the request was sent to all of them.
        """
        sending = self._send_to_others(self._encode(request), on_response)
        return asyncio.run_coroutine_threadsafe(sending, self._endpoint.loop)

    async def _send_to_others(self, body: bytes, on_response: Callable[[Any], object]) -> None:
        loop = self._endpoint.loop
        if not self.ready:
            with contextlib.suppress(TaskRpcError):
                await self.connect(loop.time() + RESOLVE_TIMEOUT)
        name = self._reached
        for address in self._endpoint.network.locate(name) if self.ready else ():
            with contextlib.suppress(TaskRpcError):
                connection = await self._endpoint.dialler.connection(address, None)
                if connection is self._connection:
                    continue
                request = Resolve(name, self._named.type_hash, self._named.node)
                resolving = connection.resolve(request, loop.time() + RESOLVE_TIMEOUT)
                method = (await resolving.future).method
                future: asyncio.Future[Any] = loop.create_future()
                call = OpenCall(future, connection, self._decode, None, method, body)
                connection.begin(call)
                future.add_done_callback(lambda it: it.exception() or on_response(it.result()))

    def _move(self, call: OpenCall) -> None:
        """Send a refused call to another server of the service."""
        task = self._endpoint.loop.create_task(self._moved(call))
        self._moves.add(task)  # the event loop keeps only weak references to tasks
        task.add_done_callback(self._moves.discard)

    async def _moved(self, call: OpenCall) -> None:
        try:
            await self.connect(call.deadline)
            assert self._connection is not None
            if not call.future.done():
                call.connection, call.method = self._connection, self._method
                self._connection.begin(call)
        except TaskRpcError as error:
            call.failed(error)


def _retrieved(task: asyncio.Task[None]) -> None:
    """Retrieve the error: without a waiting call, asyncio would report it as never retrieved."""
    if not task.cancelled():
        task.exception()
