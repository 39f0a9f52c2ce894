"""gRPC on asyncio, with generic handlers: no .proto file, no compiler, two integers as a struct."""

from __future__ import annotations

import struct
from typing import Any

import grpc

from benchmarks.harness.contender import Announce, Caller

_TWO, _ONE = struct.Struct("<qq"), struct.Struct("<q")
_SIZE = 64 * 1024 * 1024
_OPTIONS = [("grpc.max_send_message_length", _SIZE), ("grpc.max_receive_message_length", _SIZE)]


async def _add(request: tuple[int, int], context: Any) -> int:
    return request[0] + request[1]


async def _echo(request: bytes, context: Any) -> bytes:
    return request


def _one(value: int) -> bytes:
    return _ONE.pack(value)


def _one_from(data: bytes) -> int:
    return int(_ONE.unpack(data)[0])


async def serve(announce: Announce, options: list[str]) -> None:
    server = grpc.aio.server(options=_OPTIONS)
    handlers = {
        "add": grpc.unary_unary_rpc_method_handler(_add, _TWO.unpack, _one),
        "echo": grpc.unary_unary_rpc_method_handler(_echo),
    }
    handler = grpc.method_handlers_generic_handler("bench", handlers)
    server.add_generic_rpc_handlers((handler,))
    port = server.add_insecure_port("127.0.0.1:0")
    await server.start()
    announce(f"127.0.0.1:{port}")
    await server.wait_for_termination()


async def connect(place: str, options: list[str]) -> Caller:
    channel = grpc.aio.insecure_channel(place, options=_OPTIONS)
    await channel.channel_ready()
    add = channel.unary_unary("/bench/add", lambda pair: _TWO.pack(*pair), _one_from)
    echo = channel.unary_unary("/bench/echo")
    return Caller(add=lambda a, b: add((a, b)), echo=echo)
