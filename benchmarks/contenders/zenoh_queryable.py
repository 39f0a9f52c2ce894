"""Zenoh: queries that a queryable answers, over TCP from peer to peer; its Python API blocks."""

from __future__ import annotations

import json
import socket
import struct
import threading
from typing import Any

import zenoh

from benchmarks.harness.contender import Announce, Caller

_TWO, _ONE = struct.Struct("<qq"), struct.Struct("<q")


def _config(**endpoints: list[str]) -> Any:
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("peer"))
    config.insert_json5("scouting/multicast/enabled", "false")
    for side, places in endpoints.items():
        config.insert_json5(f"{side}/endpoints", json.dumps(places))
    return config


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as sock:
        return int(sock.getsockname()[1])


def _add(query: Any) -> None:
    a, b = _TWO.unpack(query.payload.to_bytes())
    query.reply("bench/add", _ONE.pack(a + b))


def _echo(query: Any) -> None:
    query.reply("bench/echo", query.payload.to_bytes())


def serve(announce: Announce, options: list[str]) -> None:
    place = f"tcp/127.0.0.1:{_free_port()}"
    with zenoh.open(_config(listen=[place])) as session:
        held = [
            session.declare_queryable("bench/add", _add),
            session.declare_queryable("bench/echo", _echo),
        ]
        announce(place)
        threading.Event().wait()
        del held


def connect(place: str, options: list[str]) -> Caller:
    session = zenoh.open(_config(connect=[place]))

    def ask(key: str, payload: bytes) -> bytes:
        for reply in session.get(key, payload=payload, timeout=60):
            return bytes(reply.ok.payload.to_bytes())
        raise ConnectionError(f"no answer to {key}")

    return Caller(
        add=lambda a, b: _ONE.unpack(ask("bench/add", _TWO.pack(a, b)))[0],
        echo=lambda data: ask("bench/echo", data),
    )
