"""Serves pages over HTTP to those who may see them; the only importer of aiohttp."""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
from collections.abc import Awaitable, Callable
from types import TracebackType
from typing import Any, Self, cast

from aiohttp import web

from taskrpc.errors import CannotListen
from taskrpc.transport.listening import Listener
from taskrpc.transport.network import Factory
from taskrpc.transport.tcp import bound, is_loopback, join_place, split_place
from taskrpc.transport.tls import ServerTls, Tls
from taskrpc.web.guard import Guard, Head, own_names
from taskrpc.web.pages import Page, Pages

log = logging.getLogger("taskrpc.web")

MAX_CONNECTIONS = 64
PATIENCE = 10.0
"""Seconds for one request and its answer, after which the connection is cut off."""

_HEADERS = {
    "Server": "taskrpc",
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


class WebServer:
    """Shows pages, and changes nothing: `async with WebServer(pages, listen="127.0.0.1:8080"):`.

    Programs of this machine may read them. Elsewhere than at this machine's own addresses it
    needs `tls` and `may_look`, which says whether a bearer token is good enough.
    """

    def __init__(
        self,
        pages: Pages,
        *,
        listen: str,
        tls: Tls | None = None,
        may_look: Callable[[str], bool] | None = None,
    ) -> None:
        self.url = ""
        """Where the pages are, once it has started."""
        self._pages = pages
        self._host, self._port = split_place(listen)
        self._tls = ServerTls(tls) if tls is not None and tls.cert is not None else None
        self._may_look = None if is_loopback(self._host) else may_look
        if not is_loopback(self._host) and (self._tls is None or may_look is None):
            raise CannotListen(
                f"cannot show pages at {self._host}: beyond this machine's own addresses"
                " (127.0.0.1, localhost, ::1) a certificate (tls) and a token are needed"
            )
        self._server: web.Server | None = None
        self._listener: Listener | None = None

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def start(self) -> None:
        """Listen. Raises CannotListen."""
        sock = bound(self._host, self._port)
        port = sock.getsockname()[1]
        names = own_names(self._host, port, machine=socket.gethostname())
        encrypted = self._tls is not None
        self.url = f"http{'s' if encrypted else ''}://{join_place(self._host, port)}"
        self._guard = Guard(names, encrypted=encrypted, may_look=self._may_look)
        self._server = web.Server(self._answer)
        factory = cast("Factory", self._protocol)
        self._listener = Listener(sock, factory, self._tls_context)

    async def close(self) -> None:
        """Cut everybody off."""
        if self._listener is not None and self._server is not None:
            listener, self._listener = self._listener, None
            await listener.close()
            await self._server.shutdown(0.0)

    def _tls_context(self) -> ssl.SSLContext | None:
        return None if self._tls is None else self._tls.context()

    def _protocol(self) -> asyncio.BaseProtocol:
        assert self._server is not None, "connections come after the start"
        if len(self._server.connections) >= MAX_CONNECTIONS:
            return _TurnedAway()
        no_log: Any = None  # a line a request would be too many
        loop = asyncio.get_running_loop()
        return _Impatient(self._server, loop=loop, access_log=no_log)

    async def _answer(self, request: web.BaseRequest) -> web.StreamResponse:
        refusal = self._guard.refusal(_head(request))
        show = self._pages.get(request.path)
        if refusal is not None:
            log.debug("refused %s: %s", request.remote, refusal.reason)
            page = Page(f"{refusal.reason}\n", status=refusal.status)
        elif show is None:
            page = Page(f"no such page; there are {', '.join(self._pages)}\n", status=404)
        else:
            page = await _shown(request.path, show)
        return _response(page)


async def _shown(path: str, show: Callable[[], Awaitable[Page]]) -> Page:
    try:
        return await show()
    except Exception:
        log.exception("the page %s cannot be shown", path)
        return Page("this page cannot be shown; see the server's log\n", status=500)


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


class _Impatient(web.RequestHandler):
    """Whatever a stranger does not say or read, he holds his place for a while only."""

    __slots__ = ("_timer",)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._timer = asyncio.get_running_loop().call_later(PATIENCE, self.force_close)

    def connection_lost(self, exc: BaseException | None) -> None:
        self._timer.cancel()
        super().connection_lost(exc)


class _TurnedAway(asyncio.Protocol):
    """A connection too many."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()
