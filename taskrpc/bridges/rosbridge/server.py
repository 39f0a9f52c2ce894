"""WebSocket connections of rosbridge clients; the only module here that imports aiohttp."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable

from aiohttp import WSCloseCode, WSMsgType, web

from taskrpc.bridges.rosbridge import protocol
from taskrpc.bridges.rosbridge.session import Bridge, Session
from taskrpc.node import Node
from taskrpc.spi import drop_dead_peers

log = logging.getLogger("taskrpc.rosbridge")

MAX_CLIENTS = 32
"""Most connected clients; a further one is refused."""
_RECEIVE_LIMIT = 2 * protocol.MAX_MESSAGE
"""Bytes of a message above which the connection is closed instead of sending an error status."""
_SMALL = 16_000
"""Most characters of a text that is written at once if nothing waits. Its bytes stay below the
64 KiB above which asyncio tells a program to wait until the client has read."""
_BEHIND = 1_000_000
"""Characters that wait to be sent above which a client gets only the newest message of a topic."""
_MAX_UNREAD = 32_000_000
"""Unread bytes above which the connection of a client is closed."""
_SILENCE, _DEAD_AFTER = 20.0, 60.0
"""Seconds without a byte after which the kernel probes a client, and seconds without an
acknowledgement after which it ends the connection. Pings of WebSocket would be shorter, but some
clients answer them only while their program waits for a message."""
_CLOSE_TIMEOUT = 0.5
"""Seconds for a client to read its last responses and that the server ends, and to confirm it."""
_ENDING = "the server is ending"


class RosbridgeServer:
    """Speaks rosbridge v2 with the clients that an HTTP server passes to `handle`.

    All clients act with the rights of `node`, so the HTTP server must check who connects. A client
    that sends a bearer token must send one for which `may_connect` returns True: accounts may see
    pages, but must not get the rights of the node.
    """

    def __init__(self, node: Node, *, may_connect: Callable[[str], bool] | None = None) -> None:
        self._bridge = Bridge(node)
        self._may_connect = may_connect
        self._clients: dict[_ClientConnection, None] = {}
        self._is_closed = False

    async def handle(self, request: web.BaseRequest) -> web.StreamResponse:
        """Accept a WebSocket request and serve the client until it leaves.

        The caller has checked the Host and Origin headers and the token. One client too many gets
        an HTTP error.
        """
        for given in request.headers.getall("Authorization", ()):
            token = given.partition(" ")[2].strip()
            if self._may_connect is not None and not self._may_connect(token):
                return _refusal(403, "expected the server's own token; rosbridge has no accounts")
        if self._is_closed:
            return _refusal(503, _ENDING)
        if len(self._clients) >= MAX_CLIENTS:
            return _refusal(503, f"{MAX_CLIENTS} clients are connected, which is the limit")
        socket = web.WebSocketResponse(
            timeout=_CLOSE_TIMEOUT,
            max_msg_size=_RECEIVE_LIMIT,
            compress=False,  # it would take longer than the call itself
        )
        if not socket.can_prepare(request):
            return _refusal(400, "expected a WebSocket request")
        await socket.prepare(request)
        client = _ClientConnection(socket, request, self._bridge)
        self._clients[client] = None
        try:
            await client.serve()
        finally:
            self._clients.pop(client, None)
        return socket

    async def close(self) -> None:
        """Tell all clients that the server ends, and close their connections; accept no more.

        Calls in flight get a response first.
        """
        self._is_closed = True
        await asyncio.gather(*(client.close() for client in list(self._clients)))


def _refusal(status: int, reason: str) -> web.Response:
    return web.Response(text=f"{reason}\n", status=status)


class _ClientConnection:
    """The WebSocket of one client, and the texts that wait to be sent on it."""

    def __init__(
        self, socket: web.WebSocketResponse, request: web.BaseRequest, bridge: Bridge
    ) -> None:
        self._socket = socket
        self._transport = request.transport
        if (sock := request.get_extra_info("socket")) is not None:
            drop_dead_peers(sock, _SILENCE, _DEAD_AFTER)
        self._peer = request.remote or "a client"
        self._session = Session(bridge, self._send, lambda: self._waiting_size > _BEHIND)
        self._waiting: deque[str] = deque()
        self._waiting_size = 0
        """Characters in `_waiting`."""
        self._wake = asyncio.Event()
        """Set while there is something to send."""
        self._all_written = asyncio.Event()
        """Set while no text waits."""
        self._all_written.set()
        self._is_ending = False

    async def serve(self) -> None:
        """Serve the client until the connection ends."""
        writer = asyncio.ensure_future(self._write())
        try:
            async for message in self._socket:
                if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    await self._session.receive(message.data)
        finally:
            self._is_ending = True
            self._session.close()
            writer.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await writer

    async def close(self) -> None:
        """End the connection with the code 1001; a client that does not read gets no more time."""
        with contextlib.suppress(ConnectionError, TimeoutError):
            async with asyncio.timeout(_CLOSE_TIMEOUT):
                await asyncio.sleep(0)  # calls that have just ended get their response
                self._session.end()
                await self._all_written.wait()
                await self._socket.close(code=WSCloseCode.GOING_AWAY, message=_ENDING.encode())
        if self._transport is not None:
            self._transport.abort()

    @property
    def _written(self) -> int:
        """Bytes that are written, but that the kernel has not taken."""
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    @property
    def _unread(self) -> int:
        """Bytes that the client has not read, roughly: texts that wait count in characters."""
        return self._waiting_size + self._written

    def _send(self, text: str) -> None:
        if self._is_ending:
            return
        if not self._wake.is_set() and len(text) <= _SMALL and not self._written:
            self._send_now(text)
            return
        self._waiting.append(text)
        self._waiting_size += len(text)
        self._wake.set()
        self._all_written.clear()
        if self._unread > _MAX_UNREAD:
            log.warning("closed the connection of %s: it does not read its messages", self._peer)
            self._is_ending = True
            if self._transport is not None:
                self._transport.abort()

    def _send_now(self, text: str) -> None:
        """Write a text at once; waking the writer costs a call one more turn of the event loop."""
        sending = self._socket.send_str(text)
        with contextlib.suppress(ConnectionError, StopIteration):  # StopIteration: it is written
            sending.send(None)
            # `send_str` has written the text, and now waits until the client has read. Do not wait
            # here: the next text goes to the writer, which does.
            sending.close()

    async def _write(self) -> None:
        with contextlib.suppress(ConnectionError):
            while True:
                while self._waiting:
                    text = self._waiting.popleft()
                    self._waiting_size -= len(text)
                    await self._socket.send_str(text)
                self._wake.clear()
                self._all_written.set()
                self._session.drained()
                if not self._waiting:
                    await self._wake.wait()
