"""Serves the pages of a task server over HTTP; the only module that imports aiohttp."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import ssl
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Self, TypeAlias, cast

import msgspec
from aiohttp import web

from taskrpc.errors import CannotListen
from taskrpc.metrics.prometheus import CONTENT_TYPE
from taskrpc.security.tls import ServerTls, Tls
from taskrpc.transport.connection.connection import shown
from taskrpc.transport.limits.log_throttling import ThrottledLog
from taskrpc.transport.network import Factory
from taskrpc.transport.tcp.listening import Listener
from taskrpc.transport.tcp.tcp_network import bound, is_loopback, join_place, split_place
from taskrpc.web.guard import Guard, Head, own_names

if TYPE_CHECKING:
    from taskrpc.metrics import Metrics
    from taskrpc.tasks import TaskServer

log = logging.getLogger("taskrpc.web")

MAX_CONNECTIONS = 64
"""Most open connections; a further one closes the oldest whose request is unfinished."""
REQUEST_TIMEOUT = 10.0
"""Seconds for one request and its response; then the connection is closed."""

_HEADERS = {
    "Server": "taskrpc",
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


class Page(msgspec.Struct, frozen=True):
    """One HTTP response."""

    body: str
    content_type: str = "text/plain; charset=utf-8"
    status: int = 200


Pages: TypeAlias = Mapping[str, Callable[[], Awaitable[Page]]]
"""The functions that make the page of each path, such as `/health`."""


Upgrade: TypeAlias = Callable[[web.BaseRequest], Awaitable[web.StreamResponse]]
"""Answers a request for a WebSocket at `/`; it returns when the WebSocket is closed."""


def task_pages(server: TaskServer, metrics: Metrics) -> Pages:
    """Return the pages `/health` (503 while no tasks are accepted) and `/metrics`."""

    async def health() -> Page:
        response = await server.health()
        body = json.dumps({"ready": response.success, "message": response.message})
        return Page(f"{body}\n", "application/json", 200 if response.success else 503)

    async def measured() -> Page:
        return Page(metrics.text(), CONTENT_TYPE)

    return {"/health": health, "/metrics": measured}


class WebServer:
    """Serves read-only pages: `async with WebServer(pages, listen="127.0.0.1:8080"):`.

    All programs of this machine may read them. To listen at any other address, it needs `tls` and
    `may_look`, which returns whether a bearer token is valid. `upgrade` answers requests for a
    WebSocket at `/`; `origins` are the pages that may open one, besides those of this machine.
    """

    def __init__(
        self,
        pages: Pages,
        *,
        listen: str,
        tls: Tls | None = None,
        may_look: Callable[[str], bool] | None = None,
        upgrade: Upgrade | None = None,
        origins: Iterable[str] = (),
    ) -> None:
        self.url = ""
        """The address of the pages; "" before the start."""
        self._pages = pages
        self._upgrade = upgrade
        self._origins = tuple(origins)
        self._host, self._port = split_place(listen)
        self._tls = ServerTls(tls) if tls is not None and tls.cert is not None else None
        self._may_look = None if is_loopback(self._host) else may_look
        if not is_loopback(self._host) and (self._tls is None or may_look is None):
            raise CannotListen(
                f"cannot show pages at {self._host}: beyond this machine's own addresses"
                " (127.0.0.1, localhost, ::1) a certificate (tls) and a token are needed"
            )
        self._server: web.Server | None = None
        self._places = _Places()
        self._listener: Listener | None = None

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        await self.close()

    async def start(self) -> None:
        """Listen. Raises CannotListen."""
        sock = bound(self._host, self._port)
        port = sock.getsockname()[1]
        names = own_names(self._host, port, machine=socket.gethostname())
        encrypted = self._tls is not None
        self.url = f"http{'s' if encrypted else ''}://{join_place(self._host, port)}"
        self._guard = Guard(
            names, encrypted=encrypted, may_look=self._may_look, origins=self._origins
        )
        self._server = web.Server(self._answer)
        factory = cast("Factory", self._protocol)
        self._listener = Listener(sock, factory, self._tls_context)

    async def close(self) -> None:
        """Close the server and all connections."""
        if self._listener is not None and self._server is not None:
            listener, self._listener = self._listener, None
            await listener.close()
            await self._server.shutdown(0.0)

    def _tls_context(self) -> ssl.SSLContext | None:
        return None if self._tls is None else self._tls.context()

    def _protocol(self) -> asyncio.BaseProtocol:
        assert self._server is not None, "connections come after the start"
        return _Connection(self._server, self._places)

    async def _answer(self, request: web.BaseRequest) -> web.StreamResponse:
        connects = request.path == "/" and self._upgrade is not None and _is_upgrade(request)
        refusal = self._guard.refusal(_head(request), connects=connects)
        show = self._pages.get(request.path)
        if refusal is not None:
            log.debug("refused %s: %s", request.remote, refusal.reason)
            page = Page(f"{refusal.reason}\n", status=refusal.status)
        elif connects and self._upgrade is not None:
            cast("_Connection", request.protocol).keep()
            return await self._upgrade(request)
        elif show is None:
            page = Page(f"no such page; there are {', '.join(self._pages)}\n", status=404)
        else:
            with self._places.kept(request.protocol):
                page = await _shown(request.path, show)
        return _response(page)


async def _shown(path: str, show: Callable[[], Awaitable[Page]]) -> Page:
    try:
        return await show()
    except Exception:
        log.exception("the page %s cannot be shown", path)
        return Page("this page cannot be shown; see the server's log\n", status=500)


def _is_upgrade(request: web.BaseRequest) -> bool:
    return request.headers.get("Upgrade", "").lower() == "websocket"


def _head(request: web.BaseRequest) -> Head:
    headers = request.headers
    local: Any = request.get_extra_info("sockname") or ("", 0)
    return Head(
        request.method,
        headers.getall("Host", ()),
        join_place(*local[:2]),
        headers.getall("Origin", ()),
        headers.getall("Authorization", ()),
    )


def _response(page: Page) -> web.Response:
    headers = {"Content-Type": page.content_type, **_HEADERS}
    if page.status == 401:
        headers["WWW-Authenticate"] = "Bearer"
    if page.status == 405:
        headers["Allow"] = "GET, HEAD"
    response = web.Response(body=page.body.encode(), status=page.status, headers=headers)
    response.force_close()
    return response


class _Places:
    """The limited set of a server's connections; unfinished requests make room for new ones."""

    def __init__(self) -> None:
        self._open: dict[web.RequestHandler, asyncio.Transport] = {}
        """Connections in order of arrival."""
        self._answered: set[web.RequestHandler] = set()
        """Connections whose response is being made."""
        self.malformed = ThrottledLog(log)

    def take(self, connection: web.RequestHandler, transport: asyncio.Transport) -> None:
        """Add a connection; if there are too many, close the oldest with an unfinished request."""
        self._open[connection] = transport
        if len(self._open) > MAX_CONNECTIONS:
            oldest = next(each for each in self._open if each not in self._answered)
            self._open.pop(oldest).abort()

    def leave(self, connection: web.RequestHandler) -> None:
        """Remove a connection that has ended."""
        self._open.pop(connection, None)

    @contextlib.contextmanager
    def kept(self, connection: web.RequestHandler) -> Iterator[None]:
        """Protect a connection from being closed for another one inside the block."""
        self._answered.add(connection)
        try:
            yield
        finally:
            self._answered.discard(connection)


class _Connection(web.RequestHandler):
    """A connection of aiohttp that is closed after `REQUEST_TIMEOUT` and logs no tracebacks."""

    __slots__ = ("_places", "_timer")

    def __init__(self, server: web.Server, places: _Places) -> None:
        no_log: Any = None  # no log line for each request
        super().__init__(server, loop=asyncio.get_running_loop(), access_log=no_log)
        self._places = places
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        writing = cast("asyncio.Transport", transport)
        # Abort, not close: with close, a peer that does not read would keep its connection.
        self._timer = asyncio.get_running_loop().call_later(REQUEST_TIMEOUT, writing.abort)
        self._places.take(self, writing)

    def keep(self) -> None:
        """Let the connection stay open for long, and do not count it."""
        self._places.leave(self)
        if self._timer is not None:
            self._timer.cancel()

    def connection_lost(self, exc: BaseException | None) -> None:
        self._places.leave(self)
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = 500,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        """Answer a request that is not valid HTTP; aiohttp would log a traceback for each."""
        if status != 400:
            return super().handle_error(request, status, exc, message)
        self._refused(exc)
        return _response(Page("expected a valid HTTP/1.1 request\n", status=status))

    def log_exception(self, *args: Any, **options: Any) -> None:
        """Log an error that aiohttp caught; a truncated body is the client's fault."""
        problem = options.get("exc_info")
        if isinstance(problem, web.RequestPayloadError):
            self._refused(problem)
        else:
            super().log_exception(*args, **options)

    def _refused(self, problem: BaseException | None) -> None:
        now, peer = asyncio.get_running_loop().time(), shown(self.peername)
        text = "refused a request from %s: it is not valid HTTP (%s)"
        self._places.malformed.warning(now, text, peer, type(problem).__name__)
