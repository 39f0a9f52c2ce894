"""NATS: request and reply by way of its server, a third process."""

from __future__ import annotations

import asyncio
import socket
import struct
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import nats

from benchmarks.harness.contender import Announce, Caller, find_program

_TWO, _ONE = struct.Struct("<qq"), struct.Struct("<q")
_PATIENCE = 30
_PAYLOAD = 64 * 1024 * 1024


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as sock:
        return int(sock.getsockname()[1])


def _started_server(port: int, folder: str) -> subprocess.Popen[bytes]:
    config = Path(folder) / "nats.conf"
    config.write_text(
        f"listen: 127.0.0.1:{port}\nmax_payload: {_PAYLOAD}\nmax_pending: {_PAYLOAD * 2}\n"
    )
    program = find_program("nats-server")
    assert program is not None
    quiet = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
    }
    return subprocess.Popen([program, "-c", str(config)], **quiet)


async def _unmoved(error: Exception) -> None:
    """The server is not there yet, or no longer: not worth a line on the terminal."""


async def _connected(place: str) -> Any:
    return await nats.connect(
        place, error_cb=_unmoved, max_reconnect_attempts=200, reconnect_time_wait=0.02
    )


async def _add(message: Any) -> None:
    a, b = _TWO.unpack(message.data)
    await message.respond(_ONE.pack(a + b))


async def _echo(message: Any) -> None:
    await message.respond(message.data)


async def serve(announce: Announce, options: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        port = _free_port()
        server = _started_server(port, folder)
        try:
            place = f"nats://127.0.0.1:{port}"
            connection = await _connected(place)
            await connection.subscribe("add", cb=_add)
            await connection.subscribe("echo", cb=_echo)
            await connection.flush()
            announce(place, server.pid)
            await asyncio.get_running_loop().create_future()
        finally:
            server.terminate()
            server.wait()


async def connect(place: str, options: list[str]) -> Caller:
    connection = await _connected(place)
    return Caller(
        add=lambda a, b: connection.request("add", _TWO.pack(a, b), timeout=_PATIENCE),
        echo=lambda data: connection.request("echo", data, timeout=_PATIENCE),
        sum_in=lambda message: _ONE.unpack(message.data)[0],
        data_in=lambda message: message.data,
    )
