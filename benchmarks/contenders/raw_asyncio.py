"""The baseline: an `asyncio.Protocol` that echoes frames behind four bytes of length.

As everybody would write it first: `data_received`, one `transport.write` a frame, a future a call.
With the option `unsplit` the server writes back whatever one read brought, frames or not: that is
no server of anything, but shows what the writes of many frames cost. With `large-first` a megabyte
went to and fro before anything is measured; see `benchmarks.harness.workloads.phases`.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

from benchmarks.harness.contender import Announce, Caller

_LENGTH = 4
_TWO_INTS = bytes(16)
_LARGE = 1024 * 1024


class Framed(asyncio.Protocol):
    """Cuts what comes into frames."""

    transport: Any

    def __init__(self) -> None:
        self._rest = bytearray()

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        rest = self._rest
        rest += data
        position = 0
        while len(rest) - position >= _LENGTH:
            begin = position + _LENGTH
            end = begin + int.from_bytes(rest[position:begin], "little")
            if end > len(rest):
                break
            self.frame_received(bytes(rest[begin:end]))
            position = end
        if position:
            del rest[:position]

    def frame_received(self, body: bytes) -> None:
        raise NotImplementedError

    def send(self, body: bytes) -> None:
        self.transport.write(len(body).to_bytes(_LENGTH, "little") + body)


class _Server(Framed):
    def frame_received(self, body: bytes) -> None:
        self.send(body)


class _Unsplit(asyncio.Protocol):
    def connection_made(self, transport: Any) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        self._transport.write(data)


class _Client(Framed):
    def __init__(self) -> None:
        super().__init__()
        self._waiting: deque[asyncio.Future[bytes]] = deque()
        self._loop = asyncio.get_running_loop()

    def call(self, body: bytes) -> asyncio.Future[bytes]:
        future = self._loop.create_future()
        self._waiting.append(future)
        self.send(body)
        return future

    def frame_received(self, body: bytes) -> None:
        future = self._waiting.popleft()
        if not future.done():
            future.set_result(body)


async def serve(announce: Announce, options: list[str]) -> None:
    protocol = _Unsplit if "unsplit" in options else _Server
    server = await asyncio.get_running_loop().create_server(protocol, "127.0.0.1", 0)
    announce(f"127.0.0.1:{server.sockets[0].getsockname()[1]}")
    await asyncio.get_running_loop().create_future()


async def connect(place: str, options: list[str]) -> Caller:
    host, port = place.split(":")
    loop = asyncio.get_running_loop()
    _, client = await loop.create_connection(_Client, host, int(port))
    if "large-first" in options:
        await client.call(bytes(_LARGE))
    return Caller(add=lambda a, b: client.call(_TWO_INTS), echo=client.call)
