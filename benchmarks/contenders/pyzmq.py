"""ZeroMQ on asyncio: a DEALER that calls a ROUTER; frames are call id, method, body."""

from __future__ import annotations

import asyncio
import itertools
import struct
from typing import Any

import zmq
import zmq.asyncio

from benchmarks.harness.contender import Announce, Caller

_TWO, _ONE = struct.Struct("<qq"), struct.Struct("<q")
_ADD, _ECHO = b"a", b"e"


async def serve(announce: Announce, options: list[str]) -> None:
    router = zmq.asyncio.Context.instance().socket(zmq.ROUTER)
    port = router.bind_to_random_port("tcp://127.0.0.1")
    announce(f"tcp://127.0.0.1:{port}")
    while True:
        peer, call, method, body = await router.recv_multipart()
        if method == _ADD:
            a, b = _TWO.unpack(body)
            body = _ONE.pack(a + b)
        await router.send_multipart([peer, call, body])


class _Client:
    """Calls by number, answered in any order."""

    def __init__(self, place: str) -> None:
        self._dealer = zmq.asyncio.Context.instance().socket(zmq.DEALER)
        self._dealer.connect(place)
        self._numbers = itertools.count()
        self._calls: dict[bytes, asyncio.Future[bytes]] = {}
        self._reader = asyncio.create_task(self._read())

    async def _read(self) -> None:
        while True:
            call, body = await self._dealer.recv_multipart()
            self._calls.pop(call).set_result(body)

    async def call(self, method: bytes, body: bytes) -> bytes:
        number = next(self._numbers).to_bytes(8, "little")
        future: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._calls[number] = future
        await self._dealer.send_multipart([number, method, body])
        return await future


async def connect(place: str, options: list[str]) -> Caller:
    client = _Client(place)

    def sum_in(body: Any) -> int:
        return int(_ONE.unpack(body)[0])

    return Caller(
        add=lambda a, b: client.call(_ADD, _TWO.pack(a, b)),
        echo=lambda data: client.call(_ECHO, data),
        sum_in=sum_in,
    )
