"""A service that passes each call to the program, which responds later, from any thread.

It is for programs that run callbacks in their own way: the program decides how many calls run at a
time, and in which order.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeAlias

from taskrpc.core.execution.callbacks import check_callback
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import IncomingCall, Offer
from taskrpc.core.transport.codec import ServiceType, codec_of
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.wire.messages import ServiceEndpoint
from taskrpc.errors import OutcomeUnknown, ServiceUnavailable, TaskRpcError
from taskrpc.message_types import RequestT, ResponseT

if TYPE_CHECKING:
    from taskrpc.core.observer import Observer, ServiceStatus


_NOT_OPEN = object()


class DeferredCall(Generic[RequestT, ResponseT]):
    """One call: `request`, and exactly one of `reply` and `fail` to end it, from any thread."""

    __slots__ = ("_call", "_service", "request")

    def __init__(self, service: DeferredService, call: IncomingCall) -> None:
        self.request: RequestT = call.request
        self._service = service
        self._call = call

    @property
    def info(self) -> IncomingCall:
        """The facts about the call that `taskrpc.current_call()` returns in a callback."""
        return self._call

    def started(self) -> bool:
        """Note that the program begins the call; returns False if the caller has cancelled it."""
        self._call.started = True
        return not self._call.cancelled

    def reply(self, response: ResponseT) -> None:
        """Send a response message.

        Raises InvalidRequest for a response that cannot be sent; the call stays open then.
        """
        service = self._service
        body = service.encode(response)
        # If other calls are open, the event loop can write many responses at once.
        if service.is_last and self._call.reply_in_thread(body):
            service.done(self._call)
        else:
            service.hand_over(partial(self._replied, response, body))

    def fail(self, error: TaskRpcError) -> None:
        """Send an error."""
        self._service.hand_over(partial(self._failed, error))

    def _replied(self, response: Any, body: bytes) -> None:
        if self._service.done(self._call):
            try:
                self._call.reply(response, body)
            except TaskRpcError as error:  # the response is too large for this caller
                self._call.fail(error)

    def _failed(self, error: TaskRpcError) -> None:
        if self._service.done(self._call):
            self._call.fail(error)


Take: TypeAlias = Callable[[DeferredCall[RequestT, ResponseT]], object]
"""Takes a call; called on the event loop's thread, it must return at once."""


class DeferredService:
    """A service that a node offers; made by `Node.create_deferred_service`."""

    def __init__(
        self,
        transport: Endpoint,
        srv_type: ServiceType,
        name: str,
        node: str,
        take: Take[Any, Any],
        *,
        join: bool = False,
        observer: Observer | None = None,
        role: Role = Role.SUBMIT,
    ) -> None:
        check_callback(take, f"`take` of {name}", ("a call",))
        self.srv_type = srv_type
        self.service_name = name
        self.loop = asyncio.get_running_loop()
        self.hand_over = transport.hand_over
        self.encode = codec_of(srv_type.Response).encode
        self.finished: asyncio.Future[None] = self.loop.create_future()
        """Done once the service is destroyed and the program has responded to its last call."""
        self._take = take
        self._open: dict[IncomingCall, object] = {}
        self._destroyed = False
        self._transport = transport
        self._offer = Offer(
            name, srv_type, node, self._arrived, join=join, observer=observer, role=role
        )
        self._others: list[ServiceEndpoint] = []
        transport.offer(self._offer)

    def add_server(self, node: str) -> None:
        """Announce another server of this service, on a node (fully qualified name).

        `take` still gets all calls. The graph then counts every server of a program that
        distributes its calls.
        """
        server = ServiceEndpoint(self.service_name, self.srv_type._TYPE, self.srv_type._HASH, node)
        self._others.append(server)
        self._transport.add_server(server)

    def remove_server(self, node: str) -> None:
        """Withdraw a server that `add_server` announced."""
        for server in self._others:
            if server.node == node:
                self._others.remove(server)
                self._transport.remove_server(server)
                return

    def destroy(self) -> None:
        """Stop offering the service; the program still responds to calls that have arrived."""
        if not self._destroyed:
            self._destroyed = True
            while self._others:
                self._transport.remove_server(self._others.pop())
            self._transport.withdraw(self._offer)
            self._finish_if_idle()

    def abandon(self) -> None:
        """Stop at once: each open call fails, with OutcomeUnknown if it has started."""
        self.destroy()
        for call in list(self._open):
            if call.started:
                call.fail(OutcomeUnknown("the server was shut down while it ran this call"))
            else:
                call.fail(ServiceUnavailable(f"{self.service_name} is withdrawn"))
            self.done(call)

    def status(self) -> ServiceStatus:
        """Return how many calls run and wait."""
        from taskrpc.core.observer import ServiceStatus  # few programs need it

        calls = list(self._open)
        running = sum(call.started for call in calls)
        return ServiceStatus(self.service_name, running, len(calls) - running, None)

    @property
    def is_last(self) -> bool:
        """Whether no more than one call is open."""
        return len(self._open) <= 1

    def done(self, call: IncomingCall) -> bool:
        """Forget a call before its response is sent; returns False if it was forgotten already.

        Any thread may call it.
        """
        if self._open.pop(call, _NOT_OPEN) is _NOT_OPEN:
            return False
        if self._destroyed:
            self.loop.call_soon_threadsafe(self._finish_if_idle)
        return True

    def _arrived(self, call: IncomingCall) -> None:
        if self._destroyed:
            call.fail(ServiceUnavailable(f"{self.service_name} is withdrawn"))
            return
        self._open[call] = None
        self._take(DeferredCall(self, call))

    def _finish_if_idle(self) -> None:
        if self._destroyed and not self._open and not self.finished.done():
            self.finished.set_result(None)
