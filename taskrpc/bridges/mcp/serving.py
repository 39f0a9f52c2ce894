"""Serves MCP over standard input and output, or over HTTP on this machine."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import threading
from collections.abc import AsyncIterator, Iterator
from typing import TYPE_CHECKING, cast

import uvicorn
from mcp.server import Server
from mcp.server.stdio import stdio_server
from mcp.server.transport_security import TransportSecuritySettings
from starlette.types import ASGIApp, Receive, Scope, Send

from taskrpc.spi import join_address, listening_socket

if TYPE_CHECKING:
    from anyio import AsyncFile

PATH = "/mcp"
"""The path of the URL for clients."""
_END = 2
"""Seconds that open responses get when the server ends."""


async def serve_stdio(server: Server[str]) -> None:
    """Serve the client that started this process, until it closes standard input."""
    lines = cast("AsyncFile[str]", _Lines())
    async with stdio_server(stdin=lines) as (read, write):
        await server.run(read, write, server.create_initialization_options())


class _Lines:
    """The lines of standard input.

    A daemon thread reads them: a thread of the package `mcp` would wait for one more line before a
    signal could end the process.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._queue: asyncio.Queue[str] = asyncio.Queue()
        threading.Thread(target=self._read, name="standard input", daemon=True).start()

    async def __aiter__(self) -> AsyncIterator[str]:
        while line := await self._queue.get():
            yield line

    def _read(self) -> None:
        # A file of its own: `sys.stdin` is closed at the end of the program, which would abort
        # because this thread still reads from it.
        with contextlib.suppress(OSError), open(0, "rb", closefd=False) as file:
            for line in file:
                self._pass_on(line.decode(errors="replace"))
        self._pass_on("")

    def _pass_on(self, line: str) -> None:
        with contextlib.suppress(RuntimeError):  # the program ends
            self._loop.call_soon_threadsafe(self._queue.put_nowait, line)


class HttpServer:
    """Serves MCP over HTTP (streamable HTTP) at a loopback address, to clients with the token."""

    def __init__(self, server: Server[str], host: str, port: int, token: str) -> None:
        self._socket = listening_socket(host, port)
        address = join_address(*self._socket.getsockname()[:2])
        self.url = f"http://{address}{PATH}"
        """The URL for clients."""
        port = self._socket.getsockname()[1]
        hosts = [address, *(join_address(each, port) for each in ("127.0.0.1", "localhost", "::1"))]
        security = TransportSecuritySettings(allowed_hosts=hosts)  # and no pages of browsers
        app = server.streamable_http_app(streamable_http_path=PATH, transport_security=security)
        config = uvicorn.Config(
            _TokenCheck(app, token),
            log_config=None,
            access_log=False,
            lifespan="on",
            timeout_graceful_shutdown=_END,
        )
        self._server = _QuietServer(config)

    async def serve(self) -> None:
        """Serve until the task is cancelled or `end` is called."""
        await self._server.serve(sockets=[self._socket])

    def end(self) -> None:
        """Let `serve` end."""
        self._server.should_exit = True


class _QuietServer(uvicorn.Server):
    """A server that leaves the signals to the command."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class _TokenCheck:
    """Refuses HTTP requests without the bearer token."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app = app
        self._token = token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or self._is_valid(scope):
            await self._app(scope, receive, send)
            return
        body = b"expected the token of this bridge in the header: Authorization: Bearer TOKEN\n"
        headers = [
            (b"content-type", b"text/plain; charset=utf-8"),
            (b"content-length", str(len(body)).encode()),
            (b"www-authenticate", b"Bearer"),
        ]
        await send({"type": "http.response.start", "status": 401, "headers": headers})
        await send({"type": "http.response.body", "body": body})

    def _is_valid(self, scope: Scope) -> bool:
        given = [value for name, value in scope["headers"] if name == b"authorization"]
        if len(given) != 1:
            return False
        scheme, _, token = given[0].partition(b" ")
        return scheme.lower() == b"bearer" and hmac.compare_digest(token.strip(), self._token)
