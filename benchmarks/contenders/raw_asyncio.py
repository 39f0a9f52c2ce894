"""The baseline: an `asyncio.Protocol` that echoes frames with four bytes of length.

As an experienced asyncio programmer writes it. All frames of one read are handled together: the
server answers them with one joined write. A body that needs several reads is kept as a list of
chunks, which are joined once. With the option `large-first` a megabyte is echoed before anything
is measured; see `benchmarks.harness.workloads.phases`.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

from benchmarks.harness.contender import Announce, Caller

_LENGTH = 4
_TWO_INTS = bytes(16)
_LARGE = 1024 * 1024


def frame(body: bytes) -> bytes:
    """The body with its length in front."""
    return len(body).to_bytes(_LENGTH, "little") + body


class Framed(asyncio.Protocol):
    """Cuts what is received into frames."""

    transport: Any

    def __init__(self) -> None:
        self._rest = b""
        """The beginning of a length."""
        self._chunks: list[bytes] = []
        """The beginning of a body, of which `_missing` bytes are still to come."""
        self._missing = 0

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        bodies: list[bytes] = []
        position, size = 0, len(data)
        if missing := self._missing:
            if size < missing:
                self._chunks.append(data)
                self._missing -= size
                return
            self._chunks.append(data[:missing])
            bodies.append(b"".join(self._chunks))
            self._chunks, self._missing, position = [], 0, missing
        elif self._rest:
            data = self._rest + data
            size = len(data)
        while size - position >= _LENGTH:
            begin = position + _LENGTH
            position = begin + int.from_bytes(data[position:begin], "little")
            if position > size:
                self._chunks, self._missing = [data[begin:]], position - size
                break
            bodies.append(data[begin:position])
        self._rest = data[position:]
        if bodies:
            self.bodies_received(bodies)

    def bodies_received(self, bodies: list[bytes]) -> None:
        raise NotImplementedError


class Server(Framed):
    """Sends back what is received."""

    def bodies_received(self, bodies: list[bytes]) -> None:
        pieces: list[bytes] = []
        for body in bodies:
            pieces += len(body).to_bytes(_LENGTH, "little"), body
        self.transport.write(b"".join(pieces))


class Client(Framed):
    """Sends frames, and completes futures in order."""

    def __init__(self) -> None:
        super().__init__()
        self._waiting: deque[asyncio.Future[bytes]] = deque()
        self._loop = asyncio.get_running_loop()

    def call(self, body: bytes) -> asyncio.Future[bytes]:
        future: asyncio.Future[bytes] = self._loop.create_future()
        self._waiting.append(future)
        self.transport.write(frame(body))
        return future

    def bodies_received(self, bodies: list[bytes]) -> None:
        for body in bodies:
            future = self._waiting.popleft()
            if not future.done():
                future.set_result(body)


async def serve(announce: Announce, options: list[str]) -> None:
    server = await asyncio.get_running_loop().create_server(Server, "127.0.0.1", 0)
    announce(f"127.0.0.1:{server.sockets[0].getsockname()[1]}")
    await asyncio.get_running_loop().create_future()


async def connect(place: str, options: list[str]) -> Caller:
    host, port = place.split(":")
    loop = asyncio.get_running_loop()
    _, client = await loop.create_connection(Client, host, int(port))
    if "large-first" in options:
        await client.call(bytes(_LARGE))
    return Caller(add=lambda a, b: client.call(_TWO_INTS), echo=client.call)
