"""The limit in pure Python: typed messages and call ids, and nothing that makes it safe.

No errors, no cancellation, no deadlines, no lookup, no limits. It reads into one shared buffer,
writes at once while nothing is in flight and once a turn of the loop otherwise.
"""

from __future__ import annotations

import asyncio
import struct
from typing import Any

import msgspec

from benchmarks.harness.contender import Announce, Caller

_HEADER = struct.Struct("<IBBHII")
_ADD, _ECHO = 0, 1
_LARGE = 16_384
"""Bytes of a body that is written by itself, because joining would copy it."""
_buffer = bytearray(65_536)
_view = memoryview(_buffer)


class _Request(msgspec.Struct, array_like=True):
    a: int
    b: int


class _Response(msgspec.Struct, array_like=True):
    sum: int


_encode = msgspec.msgpack.Encoder().encode
_decode_request = msgspec.msgpack.Decoder(_Request).decode
_decode_response = msgspec.msgpack.Decoder(_Response).decode


class _Peer(asyncio.BufferedProtocol):
    """Either end: bytes in, frames out and back."""

    transport: Any

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._rest = b""
        self._head: tuple[int, int] = (0, 0)
        self._room = memoryview(b"")
        self._body = bytearray()
        self._out: list[bytes] = []

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._room or _view

    def buffer_updated(self, nbytes: int) -> None:
        if self._room:
            self._room = self._room[nbytes:]
            if not self._room:
                body, self._body = self._body, bytearray()
                self.frame(*self._head, body)
        else:
            self._cut(self._rest + bytes(_view[:nbytes]))
        self.flush()

    def _cut(self, data: bytes) -> None:
        position = 0
        while len(data) - position >= _HEADER.size:
            size, method, _, _, call, _ = _HEADER.unpack_from(data, position)
            begin = position + _HEADER.size
            position = begin + size
            if position > len(data):
                self._begin_large(size, method, call, data[begin:])
                return
            self.frame(method, call, data[begin:position])
        self._rest = data[position:]

    def _begin_large(self, size: int, method: int, call: int, begun: bytes) -> None:
        self._rest = b""
        self._head = method, call
        self._body = bytearray(size)
        self._body[: len(begun)] = begun
        self._room = memoryview(self._body)[len(begun) :]

    def frame(self, method: int, call: int, body: bytes | bytearray) -> None:
        raise NotImplementedError

    def send(self, method: int, call: int, body: bytes | bytearray) -> None:
        header = _HEADER.pack(len(body), method, 0, 0, call, 0)
        if len(body) < _LARGE:
            self._out.append(header + body)
        else:
            self._out.append(header)
            self.flush()
            self.transport.write(body)

    def flush(self) -> None:
        if self._out:
            self.transport.write(b"".join(self._out))
            self._out.clear()


class _Server(_Peer):
    def frame(self, method: int, call: int, body: bytes | bytearray) -> None:
        if method == _ADD:
            request = _decode_request(body)
            body = _encode(_Response(request.a + request.b))
        self.send(method, call, body)


class _Client(_Peer):
    def __init__(self) -> None:
        super().__init__()
        self._calls: dict[int, asyncio.Future[Any]] = {}
        self._last = 0

    def add(self, a: int, b: int) -> asyncio.Future[_Response]:
        return self.call(_ADD, _encode(_Request(a, b)))

    def echo(self, data: bytes) -> asyncio.Future[bytes]:
        return self.call(_ECHO, data)

    def call(self, method: int, body: bytes) -> asyncio.Future[Any]:
        future = self._loop.create_future()
        self._last += 1
        if self._calls and not self._out:
            self._loop.call_soon(self.flush)
        self.send(method, self._last, body)
        if not self._calls:
            self.flush()
        self._calls[self._last] = future
        return future

    def frame(self, method: int, call: int, body: bytes | bytearray) -> None:
        future = self._calls.pop(call)
        if not future.done():
            future.set_result(_decode_response(body) if method == _ADD else body)


async def serve(announce: Announce, options: list[str]) -> None:
    server = await asyncio.get_running_loop().create_server(_Server, "127.0.0.1", 0)
    announce(f"127.0.0.1:{server.sockets[0].getsockname()[1]}")
    await asyncio.get_running_loop().create_future()


async def connect(place: str, options: list[str]) -> Caller:
    host, port = place.split(":")
    loop = asyncio.get_running_loop()
    _, client = await loop.create_connection(_Client, host, int(port))
    return Caller(client.add, client.echo, sum_in=lambda response: response.sum)
