"""A client's way to one service: finds it, resolves it, survives reconnects."""

from __future__ import annotations

import asyncio
import logging
import random
from typing import TYPE_CHECKING, Any

from taskrpc.errors import (
    AuthenticationFailed,
    PermissionDenied,
    ServiceUnavailable,
    TaskRpcError,
    TypeMismatch,
)
from taskrpc.retry import reconnect_delay
from taskrpc.transport.base import Mode
from taskrpc.transport.calling import CallFuture, CallingConnection
from taskrpc.transport.codec import ServiceType, codec_of
from taskrpc.wire.messages import Endpoint as Named
from taskrpc.wire.messages import Resolve

if TYPE_CHECKING:
    from taskrpc.transport.endpoint import Endpoint

log = logging.getLogger("taskrpc.client")

RESOLVE_TIMEOUT = 3.0


class RemoteChannel:
    """The `Channel` of an endpoint."""

    def __init__(self, endpoint: Endpoint, named: Named, srv_type: ServiceType) -> None:
        self._endpoint = endpoint
        self._named = named
        self._request = codec_of(srv_type.Request)
        self._response = codec_of(srv_type.Response)
        self._connection: CallingConnection | None = None
        self._method = 0
        self._connecting: asyncio.Task[None] | None = None
        self._mark = endpoint.mark()
        self.mode = Mode.AT_MOST_ONCE

    @property
    def ready(self) -> bool:
        """Whether `send` can be used now."""
        connection = self._connection
        return (
            connection is not None
            and connection.is_usable
            and self._method not in connection.gone_methods
        )

    def send(self, request: Any, deadline: float | None) -> CallFuture:
        """Send a request."""
        connection = self._connection
        assert connection is not None, "send() needs a ready channel"
        body = self._request.encode(request)
        return connection.call(self._method, body, self._response.decode, deadline)

    async def connect(self, deadline: float | None) -> None:
        """Find the service and reach it."""
        while not self.ready:
            if self._connecting is None or self._connecting.done():
                self._connecting = asyncio.ensure_future(self._connect())
            left = None if deadline is None else max(0.0, deadline - self._endpoint.loop.time())
            # Several calls may wait for one connection: none of them may take it from the others.
            done, _ = await asyncio.wait((self._connecting,), timeout=left)
            if not done:
                raise ServiceUnavailable(f"{self._named.name} could not be reached in time")
            self._connecting.result()

    async def wait(self, deadline: float | None) -> bool:
        """Wait until the service is there; False at the deadline."""
        failures, said = 0, ""
        while True:
            try:
                await self.connect(deadline)
                return True
            except TypeMismatch as error:
                if said != str(error):
                    said = str(error)
                    log.warning("%s", error)
            except TaskRpcError as error:
                log.debug("%s", error)
            left = None if deadline is None else deadline - self._endpoint.loop.time()
            if left is not None and left <= 0:
                return False
            failures = await self._something_new(failures, left)

    def close(self) -> None:
        """Forget the service."""
        if self._connecting is not None:
            self._connecting.cancel()
        self._endpoint.channel_closed(self._named)

    async def _something_new(self, failures: int, left: float | None) -> int:
        """Wait for a sign that another attempt may succeed."""
        # A peer in no directory gives no sign; it is asked again at growing intervals.
        has_peers = bool(self._endpoint.network.peers())
        delay = reconnect_delay(failures, random.random()) if has_peers else None
        limits = [each for each in (left, delay) if each is not None]
        change = asyncio.ensure_future(self._endpoint.wait_for_change(self._mark))
        try:
            done, _ = await asyncio.wait((change,), timeout=min(limits, default=None))
        finally:
            change.cancel()
        return 0 if done else failures + 1

    async def _connect(self) -> None:
        self._mark = self._endpoint.mark()
        problem: TaskRpcError = ServiceUnavailable(f"nobody offers {self._named.name}")
        for address in self._endpoint.network.locate(self._named.name):
            try:
                connection = await self._endpoint.connection(address, None)
                question = Resolve(self._named.name, self._named.type_hash)
                limit = self._endpoint.loop.time() + RESOLVE_TIMEOUT
                resolved = await connection.resolve(question, limit)
            except (TypeMismatch, AuthenticationFailed, PermissionDenied):
                raise
            except TaskRpcError as error:
                if address.surely_offers or not isinstance(error, ServiceUnavailable):
                    problem = _unreachable(self._named.name, error)
                continue
            self._connection, self._method = connection, resolved.method
            self.mode = Mode(resolved.mode)
            return
        raise problem


def _unreachable(name: str, error: TaskRpcError) -> TaskRpcError:
    if isinstance(error, ServiceUnavailable):
        return error
    return ServiceUnavailable(f"{name} could not be reached: {error}")
