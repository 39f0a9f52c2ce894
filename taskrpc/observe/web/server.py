"""Serves the pages of a task server over HTTP; with `control`, the live page; imports aiohttp."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from typing import Any, Protocol, Self, TypeAlias, cast

import msgspec
from aiohttp import HttpVersion11, web

from taskrpc import Tls
from taskrpc.errors import CannotListen
from taskrpc.observe.web.control import MAX_BODY
from taskrpc.observe.web.guard import Access, Guard, Head, local_port, own_names
from taskrpc.observe.web.open_connections import OpenConnections, TooManyRequests
from taskrpc.observe.web.pages import JSON, Page, Pages
from taskrpc.observe.web.peers import is_other_user, is_page_of_other_user
from taskrpc.observe.web.streams import UNREAD_BYTES, LiveStream, Tab, TooManyTabs
from taskrpc.observe.web.tokens import Holder, Tokens
from taskrpc.spi import (
    Factory,
    Listener,
    ServerTls,
    ThrottledLog,
    is_loopback,
    join_address,
    listening_socket,
    split_address,
)

log = logging.getLogger("taskrpc.web")

REQUEST_TIMEOUT = 10.0
"""Seconds for one request and its response; then the connection is closed."""
RECORDING_TIMEOUT = 120.0
"""Seconds for the request and the response of a recording; a slow computer reads it slowly."""
EVERYWHERE = ("0.0.0.0", "::", "")
"""The hosts with which a server listens at all addresses; no browser can open them."""
_END_GRACE = 0.1
"""Seconds for requests in progress when the server ends. aiohttp takes 0 for no limit."""

CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:;"
    " connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""The live page loads only its own files, and no other page can contain it."""

_HEADERS = {
    "Server": "taskrpc",
    "Cache-Control": "no-store",
    "Content-Security-Policy": CONTENT_SECURITY_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
RETRY_AFTER = "5"
"""Seconds after which a client may repeat a request that got status 503."""
_BUSY = "too many requests arrive at the same time; try again in some seconds\n"

Upgrade: TypeAlias = Callable[[web.BaseRequest], Awaitable[web.StreamResponse]]
"""Serves a request for a WebSocket at `/`; it returns when the WebSocket is closed."""


class Events(Protocol):
    """What the live page shows; see `taskrpc.observe.web.live.Live`."""

    def hello(self, *, control: bool) -> bytes:
        """Return the first event of a page as text."""

    def task(self, task_id: int) -> bytes | None:
        """Return one task as JSON, None if there is none."""


class Controls(Protocol):
    """What the buttons and keys of the page do; see `taskrpc.observe.web.control.Control`."""

    async def answer(self, verb: str, content_type: str, body: bytes, holder: Holder) -> Page:
        """Answer a request for `/control/VERB` of a user whose token allows control."""

    async def close(self) -> None:
        """The server ends."""


class RecordedEvents(Protocol):
    """The events of a recording; see `taskrpc.observe.recording.timeline.Timeline`."""

    def lines(self) -> Iterator[bytes]:
        """Iterate over parts of a text with an event as JSON on each line."""

    def gzipped(self) -> Iterator[bytes]:
        """Iterate over the same text as parts of one gzip stream."""


class LivePage(msgspec.Struct, frozen=True, eq=False):
    """The parts of the live page."""

    files: Mapping[str, Page]
    """The files of the page by path; see `static_files`."""
    tokens: Tokens
    """The tokens that the page accepts."""
    stream: LiveStream
    """The open pages."""
    events: Events
    """What they show."""
    control: Controls | None = None
    """Their buttons; None for a read-only page."""
    recording: RecordedEvents | None = None
    """The recording that `/recording` serves; None for the page of a running server."""


class WebServer:
    """Serves pages: `async with WebServer(pages, listen="127.0.0.1:8080"):`.

    All programs of this machine may read `pages`. To listen at any other address, it needs `tls`
    and `may_look`, which returns whether a bearer token is valid.

    Args:
        pages: the pages by path.
        listen: `HOST:PORT`; port 0 means any free port.
        tls: the certificate and the key.
        may_look: returns whether a bearer token is valid.
        live: the live page; without it, there are only `pages`.
        upgrade: answers requests for a WebSocket at `/`; without it, they are refused.
        origins: other pages that may open a WebSocket, besides those that this user serves on this
            machine; also the addresses under which a reverse proxy serves these pages, such as
            `https://lab.example`. Requests for the name of such an address need a token.
        names: more names or addresses of this machine that are valid in a Host header; the first
            one stands in `url` if `listen` means all addresses.
    """

    def __init__(
        self,
        pages: Pages,
        *,
        listen: str,
        tls: Tls | None = None,
        may_look: Callable[[str], bool] | None = None,
        live: LivePage | None = None,
        upgrade: Upgrade | None = None,
        origins: Iterable[str] = (),
        names: Iterable[str] = (),
    ) -> None:
        self.url = ""
        """The address of the pages; "" before the start."""
        self._pages = pages
        self._live = live
        self._upgrade = upgrade
        self._origins = tuple(origins)
        self._names = tuple(names)
        self._host, self._port = split_address(listen)
        self._tls = ServerTls(tls) if tls is not None and tls.cert is not None else None
        self._may_look = may_look
        if not is_loopback(self._host) and (self._tls is None or may_look is None):
            raise CannotListen(
                f"cannot serve pages at {self._host} without a certificate and a token, because"
                " other machines can reach this address; give --tls-cert, --tls-key and"
                " --token-file (in Python tls and may_look), or listen at 127.0.0.1"
            )
        self._server: web.Server | None = None
        self._connections = OpenConnections()
        self._malformed = ThrottledLog(log)
        self._refused = ThrottledLog(log)
        self._listener: Listener | None = None

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        await self.close()

    async def start(self) -> None:
        """Listen. Raises CannotListen."""
        sock = listening_socket(self._host, self._port)
        port = sock.getsockname()[1]
        names = own_names(self._host, port, machine=socket.gethostname())
        names += [join_address(name, port) for name in self._names]
        encrypted = self._tls is not None
        host = self._host
        if host in EVERYWHERE and self._names:
            host = self._names[0]
        self.url = f"http{'s' if encrypted else ''}://{join_address(host, port)}"
        self._guard = Guard(
            names,
            encrypted=encrypted,
            may_look=self._may_look,
            is_local=is_loopback(self._host),
            tokens=None if self._live is None else self._live.tokens,
            origins=self._origins,
        )
        self._server = web.Server(self._answer)
        factory = cast("Factory", self._protocol)
        self._listener = Listener(sock, factory, self._tls_context)

    async def close(self) -> None:
        """Close the server and all connections."""
        if self._listener is not None and self._server is not None:
            listener, self._listener = self._listener, None
            await listener.close()
            if self._live is not None:
                self._live.stream.close("the server is ending")
                await asyncio.sleep(0)  # the streams end before their connections
                if self._live.control is not None:
                    await self._live.control.close()
            await self._server.shutdown(_END_GRACE)

    def _tls_context(self) -> ssl.SSLContext | None:
        return None if self._tls is None else self._tls.context()

    def _protocol(self) -> asyncio.BaseProtocol:
        assert self._server is not None, "connections come after the start"
        return _Connection(self._server, self._connections, self._malformed)

    async def _answer(self, request: web.BaseRequest) -> web.StreamResponse:
        connection = cast("_Connection", request.protocol)
        connection.is_answered = True
        path, access = request.path, self._access(request)
        head = _head(request, access)
        if refusal := self._guard.refusal(head, access):
            if access is Access.CONNECT:  # a browser does not show the reason to its user
                now, text = asyncio.get_running_loop().time(), "refused a WebSocket of %s: %s"
                self._refused.warning(now, text, request.remote, refusal.reason)
            log.debug("refused %s: %s", request.remote, refusal.reason)
            if access is Access.CONTROL:
                error = "AuthenticationFailed" if refusal.status == 401 else "RequestError"
                return _response(_problem(error, refusal.reason, refusal.status), access)
            return _response(Page(f"{refusal.reason}\n", status=refusal.status), access)
        if access is Access.CONNECT and self._upgrade is not None:
            connection.keep()
            response = await self._upgrade(request)
            if not response.prepared:  # a refusal, as text; otherwise the WebSocket has ended
                response.headers.update(_HEADERS)
                response.force_close()
            return response
        if path == "/live" and self._live is not None:
            return await self._stream(request, connection, self._live, head)
        if path == "/recording" and self._live is not None and self._live.recording is not None:
            return await _recording(request, connection, self._live.recording)
        try:
            with self._connections.kept(connection, asyncio.get_running_loop().time()):
                page = await self._page(request, head)
        except TooManyRequests:
            page = Page(_BUSY, status=503)
        return _response(page, access, request.headers.get("If-None-Match", ""))

    def _access(self, request: web.BaseRequest) -> Access:
        path, live = request.path, self._live
        if path == "/" and self._upgrade is not None and _is_upgrade(request):
            return Access.CONNECT
        if live is None or path in self._pages:
            return Access.MONITOR
        if path.startswith("/control/"):
            return Access.CONTROL
        return Access.LOAD if path in live.files else Access.LOOK

    async def _page(self, request: web.BaseRequest, head: Head) -> Page:
        path, live = request.path, self._live
        if make := self._pages.get(path):
            return await _shown(path, make)
        if live is not None:
            if file := live.files.get(path):
                return file
            if path.startswith("/control/") and live.control is not None:
                return await self._controlled(request, head, live.control)
            if path.startswith("/task/"):
                return _task(live, path.removeprefix("/task/"))
        known = ("/", "/live", *self._pages) if live is not None else self._pages
        return Page(f"no such page; there are {', '.join(known)}\n", status=404)

    async def _controlled(self, request: web.BaseRequest, head: Head, control: Controls) -> Page:
        holder = self._guard.holder(head)
        assert holder is not None, "the guard has checked the token"
        body = b""
        try:
            while len(body) <= MAX_BODY and (more := await request.content.read(MAX_BODY + 1)):
                body += more
        except (web.RequestPayloadError, ValueError) as error:
            return _problem("RequestError", f"the body cannot be read: {error}"[:200], 400)
        verb = request.path.removeprefix("/control/")
        return await control.answer(verb, request.content_type, body, holder)

    async def _stream(
        self, request: web.BaseRequest, connection: _Connection, live: LivePage, head: Head
    ) -> web.StreamResponse:
        """Send events until the page is closed or the server ends."""
        if request.version < HttpVersion11 or request.method != "GET":
            return _response(Page("expected a GET request with HTTP/1.1\n", status=400))
        try:
            tab, states = live.stream.open(connection)
        except TooManyTabs:
            text = "too many live pages are open; close some of them, then try again\n"
            return _response(Page(text, status=503))
        response = web.StreamResponse(headers={**_HEADERS, "X-Accel-Buffering": "no"})
        response.content_type = "text/event-stream"
        response.enable_chunked_encoding()
        response.force_close()
        try:
            tab.pause()  # until its first bytes are written
            connection.keep(tab)
            await response.prepare(request)
            holder = self._guard.holder(head)
            hello = live.events.hello(control=holder is not None and holder.may_control)
            await response.write(hello + states)
            if not connection.is_full:
                tab.resume()
            await tab.closed
        except ConnectionError:
            log.debug("a live page of %s was closed at once", request.remote)
        finally:
            tab.close()
        return response


async def _recording(
    request: web.BaseRequest, connection: _Connection, recorded: RecordedEvents
) -> web.StreamResponse:
    """Send the events of a recording part by part, compressed if the browser accepts it."""
    is_gzip = "gzip" in request.headers.get("Accept-Encoding", "")
    response = web.StreamResponse(headers={**_HEADERS, "Vary": "Accept-Encoding"})
    response.content_type = "application/x-ndjson"
    if is_gzip:
        response.headers["Content-Encoding"] = "gzip"
    response.force_close()
    connection.keep()
    try:
        async with asyncio.timeout(RECORDING_TIMEOUT):
            await response.prepare(request)
            if request.method != "HEAD":
                for part in recorded.gzipped() if is_gzip else recorded.lines():
                    await response.write(part)
    except (ConnectionError, TimeoutError):
        log.debug("the recording was not read to its end by %s", request.remote)
        connection.abort()
    return response


async def _shown(path: str, show: Callable[[], Awaitable[Page]]) -> Page:
    try:
        return await show()
    except Exception:
        log.exception("the page %s could not be made", path)
        return Page("the server could not make this page; see its log\n", status=500)


def _task(live: LivePage, number: str) -> Page:
    is_number = number.isascii() and number.isdecimal() and len(number) < 16
    body = live.events.task(int(number)) if is_number else None
    if body is None:
        return _problem("NotFound", f"There is no task {number[:40]}", 404)
    return Page(body, JSON)


def _problem(error: str, message: str, status: int) -> Page:
    return Page(msgspec.json.encode({"error": error, "message": message}), JSON, status)


def _is_upgrade(request: web.BaseRequest) -> bool:
    return request.headers.get("Upgrade", "").lower() == "websocket"


def _head(request: web.BaseRequest, access: Access) -> Head:
    headers = request.headers
    is_for_everybody = access in (Access.MONITOR, Access.LOAD)
    local: Any = request.get_extra_info("sockname") or ("", 0)
    peer: Any = request.get_extra_info("peername") or ("", 0)
    origins = headers.getall("Origin", ())
    ports = [local_port(origin.lower()) for origin in origins if access is Access.CONNECT]
    return Head(
        request.method,
        headers.getall("Host", ()),
        join_address(*local[:2]),
        origins,
        headers.getall("Sec-Fetch-Site", ()),
        headers.getall("Authorization", ()),
        not is_for_everybody and cast("_Connection", request.protocol).is_other_user,
        any(port is not None and is_page_of_other_user(peer[:2], port) for port in ports),
    )


def _response(page: Page, access: Access = Access.MONITOR, known: str = "") -> web.Response:
    headers = {"Content-Type": page.content_type, **_HEADERS}
    status, body = page.status, page.body if isinstance(page.body, bytes) else page.body.encode()
    if page.etag:
        headers |= {"ETag": page.etag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
        if page.etag in (each.strip().removeprefix("W/") for each in known.split(",")):
            status, body = 304, b""
    if status == 401:
        headers["WWW-Authenticate"] = "Bearer"
    if status == 503:
        headers["Retry-After"] = RETRY_AFTER
    if status == 405:
        headers["Allow"] = "POST" if access is Access.CONTROL else "GET, HEAD"
    response = web.Response(body=body, status=status, headers=headers)
    response.force_close()
    if page.etag and body:
        response.enable_compression()  # for clients that accept it; a file gets a third of its size
    return response


def _as_text(response: web.Response) -> bytes:
    """Return a response as HTTP writes it."""
    lines = [f"HTTP/1.1 {response.status} {response.reason}"]
    lines += [f"{name}: {value}" for name, value in response.headers.items()]
    body = cast("bytes", response.body)
    lines += [f"Content-Length: {len(body)}", "Connection: close", "", ""]
    return "\r\n".join(lines).encode() + body


_TOO_MANY = _as_text(_response(Page(_BUSY, status=503)))
"""The response to a connection that is closed before its request arrived."""


class _Connection(web.RequestHandler):
    """A connection of aiohttp that is closed after `REQUEST_TIMEOUT` and logs no tracebacks."""

    __slots__ = (
        "_connections",
        "_is_other_user",
        "_malformed",
        "_tab",
        "_timer",
        "_writing",
        "is_answered",
        "is_full",
    )

    def __init__(
        self, server: web.Server, connections: OpenConnections, malformed: ThrottledLog
    ) -> None:
        no_log: Any = None  # no log line for each request
        super().__init__(server, loop=asyncio.get_running_loop(), access_log=no_log)
        self._connections = connections
        self._malformed = malformed
        self._timer: asyncio.TimerHandle | None = None
        self._writing: asyncio.Transport | None = None
        self._tab: Tab | None = None
        """The event stream of this connection; None for other requests."""
        self._is_other_user: bool | None = None
        self.is_answered = False
        """Whether the response has begun to be made."""
        self.is_full = False
        """Whether too many bytes are unread."""

    @property
    def is_other_user(self) -> bool:
        """Whether a process of another user of this machine has connected."""
        if self._is_other_user is None and self._writing is not None:
            peer = self._writing.get_extra_info("peername") or ("", 0)
            local = self._writing.get_extra_info("sockname") or ("", 0)
            self._is_other_user = is_other_user(peer[:2], local[:2])
        return self._is_other_user is not False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._writing = writing = cast("asyncio.Transport", transport)
        # Abort, not close: with close, a peer that does not read would keep its connection.
        self._timer = asyncio.get_running_loop().call_later(REQUEST_TIMEOUT, writing.abort)
        self._connections.add(self, asyncio.get_running_loop().time())

    def connection_lost(self, exc: BaseException | None) -> None:
        self._leave()
        if self._tab is not None:
            self._tab.close()
        super().connection_lost(exc)

    def make_room(self) -> None:
        """Close at once, because there are too many connections; say so to the client."""
        if self._writing is not None and not self._writing.is_closing():
            if not self.is_answered:
                self._writing.write(_TOO_MANY)  # the system has it before the connection is aborted
            self._writing.abort()

    def keep(self, tab: Tab | None = None) -> None:
        """Let the connection stay open, for the event stream of a tab or for a WebSocket."""
        self._leave()
        self._tab = tab
        if tab is not None and self._writing is not None:
            self._writing.set_write_buffer_limits(high=UNREAD_BYTES)
            if sock := self._writing.get_extra_info("socket"):  # keep few outdated events
                with contextlib.suppress(OSError):  # the page may be closed already
                    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD_BYTES)

    def pause_writing(self) -> None:
        super().pause_writing()
        self.is_full = True
        if self._tab is not None:
            self._tab.pause()

    def resume_writing(self) -> None:
        super().resume_writing()
        self.is_full = False
        if self._tab is not None:
            self._tab.resume()

    # A connection of a tab

    def write(self, data: bytes) -> None:
        """Send bytes of an event stream as they are."""
        if self._writing is not None and not self._writing.is_closing():
            self._writing.write(data)

    def abort(self) -> None:
        """Close the connection at once."""
        if self._writing is not None:
            self._writing.abort()

    def _leave(self) -> None:
        self._connections.remove(self)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

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
        now = asyncio.get_running_loop().time()
        peer = join_address(*self.peername[:2]) if self.peername else "a client"
        text = "refused a request from %s: it is not valid HTTP (%s)"
        self._malformed.warning(now, text, peer, type(problem).__name__)
