"""A proxy in front of PostgreSQL that breaks a connection at a COMMIT."""

from __future__ import annotations

import asyncio
import weakref

SWALLOW, CUT, SHUT_DOWN = "commit swallowed", "answer lost", "session ended after the commit"
"""The COMMIT never reaches PostgreSQL; or its answer never comes back; or PostgreSQL reports that
it ends the session, after the COMMIT and before it is ready again."""

_READY = b"Z\0\0\0\5I"
"""The message that ends the answer of a transaction."""


def _fatal() -> bytes:
    """The message of a PostgreSQL that is being shut down."""
    fields = "SFATAL", "VFATAL", "C57P01", "Mterminating connection due to administrator command"
    body = b"".join(field.encode() + b"\0" for field in fields) + b"\0"
    return b"E" + (len(body) + 4).to_bytes(4, "big") + body


class PostgresProxy:
    """Listens on a free port of 127.0.0.1 and passes everything on, until a fault is armed."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._fault, self._what = "", b""
        self._goes_away = False
        self.is_away = False
        """Whether new connections are broken at once."""
        self.is_black_hole = False
        """Whether everything that is sent disappears, and no new connection gets an answer."""
        self.port = 0
        self._server: asyncio.Server | None = None
        self._serving: set[asyncio.Task[None]] = set()
        self._clients: weakref.WeakSet[asyncio.StreamWriter] = weakref.WeakSet()
        self._ending: weakref.WeakSet[asyncio.StreamWriter] = weakref.WeakSet()

    async def __aenter__(self) -> PostgresProxy:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None, "it was started"
        self.is_away = True  # for connections that are being accepted
        self._server.close()
        for serving in self._serving:
            serving.cancel()
        if self._serving:
            await asyncio.wait(self._serving)
        self.break_sessions()
        await asyncio.sleep(0)  # asyncio closes aborted sockets in its next turn

    def arm(self, fault: str, *, away: bool = False, what: bytes = b"taskrpc_writer") -> None:
        """Let the fault happen at the next COMMIT of a transaction that has written.

        With `away`, the database is away from then on, until `is_away` is reset. `what` is a part
        of the statements of that transaction. A session must be young: later, it names prepared
        statements instead of sending them.
        """
        self._fault, self._goes_away, self._what = fault, away, what

    def break_sessions(self) -> None:
        """Break all connections, so that the next sessions are young."""
        for each in self._clients:
            each.transport.abort()

    @property
    def is_armed(self) -> bool:
        """Whether the fault has not happened yet."""
        return bool(self._fault)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.is_away:
            writer.transport.abort()
            return
        self._clients.add(writer)
        serving = asyncio.create_task(self._serve(reader, writer))
        self._serving.add(serving)
        serving.add_done_callback(self._serving.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            inner = await asyncio.open_connection("127.0.0.1", self._target)
        except OSError:
            writer.close()
            return
        self._clients.add(inner[1])
        up = asyncio.create_task(self._pass_up(reader, inner, writer))
        down = asyncio.create_task(self._pass_down(inner[0], writer))
        try:
            await asyncio.wait({up, down}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for each in (up, down):
                each.cancel()
            await asyncio.wait({up, down})
            for each in (inner[1], writer):
                each.transport.abort()

    async def _pass_up(
        self,
        reader: asyncio.StreamReader,
        inner: tuple[asyncio.StreamReader, asyncio.StreamWriter],
        down: asyncio.StreamWriter,
    ) -> None:
        up, recent = inner[1], b""
        while data := await reader.read(65536):
            recent = recent[-65536:] + data
            if self._fault and b"COMMIT\0" in data and self._what in recent:
                fault, self._fault = self._fault, ""
                self.is_away = self._goes_away
                await self._break(fault, data, up, down)
                return
            if not self.is_black_hole:
                up.write(data)
                await up.drain()

    async def _break(
        self, fault: str, data: bytes, up: asyncio.StreamWriter, down: asyncio.StreamWriter
    ) -> None:
        if fault == SWALLOW:
            return
        if fault == CUT:
            down.transport.abort()  # first, so that no answer passes
        else:
            self._ending.add(down)
        up.write(data)
        await up.drain()
        await asyncio.sleep(0.3)

    async def _pass_down(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(65536):
            if writer in self._ending and data.endswith(_READY):
                data = data.removesuffix(_READY) + _fatal()
            if not self.is_black_hole:
                writer.write(data)
                await writer.drain()
