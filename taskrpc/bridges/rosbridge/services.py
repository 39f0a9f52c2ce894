"""Services for clients of rosbridge: the ones that they call, and the ones that they offer."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any, TypeAlias

import srvgen
from taskrpc.bridges.rosbridge.protocol import AdvertiseService, ServiceResponse
from taskrpc.bridges.rosbridge.types import service_class
from taskrpc.bridges.rosbridge.values import from_json, request_from_json, to_json
from taskrpc.client import Client
from taskrpc.errors import Code, DeadlineExceeded, HandlerError, TypeMismatch
from taskrpc.node import Node

Send: TypeAlias = Callable[[Mapping[str, Any]], object]
"""Sends an operation to the client."""

_KEPT_CLIENTS = 512
"""Services for which the gateway keeps a client; it closes the ones used least recently."""
_MAX_OPEN = 64
"""Calls of one offered service that wait for the client's response; later ones queue up."""


class ServiceClients:
    """Calls services by name, with the types that their servers report; for all sessions."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: OrderedDict[str, Client[Any, Any]] = OrderedDict()
        """In order of their last use."""
        self._resolved = lru_cache(_KEPT_CLIENTS)(node.resolve_service_name)

    def begin(self, name: str, args: object, timeout: float | None) -> asyncio.Future[Any] | None:
        """Send a call now; return the future of the response message.

        Cancelling the future cancels the call. It may end with TypeMismatch: then `call` finds out
        the new definition. None means that the definition is not known yet, so use `call`.

        Raises InvalidName, FieldError.
        """
        service = self._resolved(name)
        client = self._clients.get(service)
        if client is None or not client.service_is_ready():
            return None
        self._clients.move_to_end(service)
        request = request_from_json(client.srv_type.Request, args)
        return client.call_async(request, timeout=timeout)

    async def call(self, name: str, args: object, timeout: float | None) -> dict[str, Any]:
        """Call a service with the arguments of a `call_service`; return the response as JSON.

        `timeout` (seconds, None for no deadline) covers everything.

        Raises the errors of `Client.call`, FieldError and DefinitionError.
        """
        deadline = None if timeout is None else asyncio.get_running_loop().time() + timeout
        service = self._resolved(name)
        try:
            return await self._attempt(service, args, deadline)
        except TypeMismatch:  # a server with another definition has replaced the earlier one
            self.forget(service)
            return await self._attempt(service, args, deadline)

    async def client(self, service: str, deadline: float | None) -> Client[Any, Any]:
        """Return a client with the definition that the server of an absolute name reports.

        The client may be closed after calls of many other services. `deadline` is an instant on the
        clock of the event loop, None for none.

        Raises ServiceUnavailable, DeadlineExceeded, DefinitionError.
        """
        client = self._clients.get(service)
        if client is None or not client.service_is_ready():
            client = await self._find(service, deadline)
        self._clients.move_to_end(service)
        return client

    async def _attempt(self, service: str, args: object, deadline: float | None) -> dict[str, Any]:
        client = await self.client(service, deadline)
        request = request_from_json(client.srv_type.Request, args)
        left = None if deadline is None else deadline - asyncio.get_running_loop().time()
        return to_json(await client.call(request, timeout=left))

    async def _find(self, service: str, deadline: float | None) -> Client[Any, Any]:
        """Return a client with the definition that the server reports."""
        try:
            async with asyncio.timeout_at(deadline):
                type_name, text = await self._node.definition(service)
        except TimeoutError:
            problem = f"the server of {service} did not report its definition in time"
            raise DeadlineExceeded(problem, not_executed=True) from None
        cls = srvgen.define(type_name, text)
        known = self._clients.get(service)
        if known is not None and known.srv_type is cls:
            return known
        self.forget(service)
        self._clients[service] = made = self._node.create_client(cls, service)
        while len(self._clients) > _KEPT_CLIENTS:
            self.forget(next(iter(self._clients)))
        return made

    def forget(self, service: str) -> None:
        """Close the client of a service, because the definition of the service has changed."""
        if (client := self._clients.pop(service, None)) is not None:
            client.destroy()


class OfferedService:
    """A service that a client offers: each call becomes a `call_service` for the client.

    `numbers` numbers all calls of the client. A number that came twice would let the response to a
    call of an earlier service, which the client has offered again, answer a call of this one.
    """

    def __init__(
        self, node: Node, operation: AdvertiseService, send: Send, numbers: Iterator[int]
    ) -> None:
        cls = service_class(operation.type)
        self._name = operation.service  # as the client spells it, because it compares the names
        self._send = send
        self._response = cls.Response
        self._open: dict[str, asyncio.Future[Any]] = {}
        """The calls that wait for the client's response, by id."""
        self._numbers = numbers
        self._service = node.create_service(
            cls, operation.service, self._called, concurrency=_MAX_OPEN
        )

    async def _called(self, request: Any, _: Any) -> Any:
        name = f"service_request:{self._name}:{next(self._numbers)}"
        response: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._open[name] = response
        args = to_json(request)
        self._send({"op": "call_service", "id": name, "service": self._name, "args": args})
        try:
            return await response
        finally:
            del self._open[name]

    def waits_for(self, operation: ServiceResponse) -> bool:
        """Whether the response belongs to an open call of this service."""
        return operation.id in self._open

    def respond(self, operation: ServiceResponse) -> None:
        """End a call with the client's response.

        Raises FieldError for a response that does not fit; the caller gets an error too.
        """
        future = self._open[str(operation.id)]
        if future.done():  # its caller has cancelled it just now
            return
        if not operation.result:
            reason = operation.values if isinstance(operation.values, str) else ""
            future.set_exception(HandlerError(Code.UNKNOWN, reason or "the service failed"))
            return
        values = {} if operation.values is None else operation.values
        try:
            future.set_result(from_json(self._response, values))
        except srvgen.FieldError as error:
            problem = f"the rosbridge client of the service sent an invalid response: {error}"
            future.set_exception(HandlerError(Code.INTERNAL, problem))
            raise

    def close(self) -> None:
        """Withdraw the service; open calls end with OutcomeUnknown."""
        self._service.abandon()
