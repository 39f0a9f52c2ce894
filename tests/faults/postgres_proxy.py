"""A proxy in front of PostgreSQL that cuts a connection at a COMMIT."""

from __future__ import annotations

import asyncio

SWALLOW, CUT = "commit swallowed", "answer lost"
"""The COMMIT never reaches PostgreSQL; or it does, and its answer never comes back."""


class PostgresProxy:
    """Listens on a free port of 127.0.0.1 and passes everything on, until a fault is armed."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._fault = ""
        self.is_black_hole = False
        """Whether everything that is sent disappears, and no new connection gets an answer."""
        self.port = 0
        self._server: asyncio.Server | None = None
        self._serving: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> PostgresProxy:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None, "it was started"
        self._server.close()
        for serving in self._serving:
            serving.cancel()
        if self._serving:
            await asyncio.wait(self._serving)
        await asyncio.sleep(0)  # asyncio closes aborted sockets in its next turn

    def arm(self, fault: str) -> None:
        """Let the fault happen at the next COMMIT of a transaction that has written."""
        self._fault = fault

    @property
    def is_armed(self) -> bool:
        """Whether the fault has not happened yet."""
        return bool(self._fault)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        serving = asyncio.current_task()
        self._serving.add(serving)
        serving.add_done_callback(self._serving.discard)
        try:
            inner = await asyncio.open_connection("127.0.0.1", self._target)
        except OSError:
            writer.close()
            return
        up = asyncio.create_task(self._pass_up(reader, inner[1], writer))
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
        up: asyncio.StreamWriter,
        down: asyncio.StreamWriter,
    ) -> None:
        while data := await reader.read(65536):
            if self._fault and b"COMMIT" in data and b"taskrpc_writer" in data:
                fault, self._fault = self._fault, ""
                if fault == CUT:
                    down.transport.abort()  # first, so that no answer passes
                    up.write(data)
                    await up.drain()
                    await asyncio.sleep(0.3)
                return
            if not self.is_black_hole:
                up.write(data)
                await up.drain()

    async def _pass_down(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(65536):
            if not self.is_black_hole:
                writer.write(data)
                await writer.drain()
