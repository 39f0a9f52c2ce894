"""RPyC: remote objects, blocking, a thread a connection; the methods are looked up once."""

from __future__ import annotations

import time

import rpyc
from rpyc.utils.server import ThreadedServer

from benchmarks.harness.contender import Announce, Caller


class _Bench(rpyc.Service):
    def exposed_add(self, a: int, b: int) -> int:
        return a + b

    def exposed_echo(self, data: bytes) -> bytes:
        return data


def serve(announce: Announce, options: list[str]) -> None:
    server = ThreadedServer(_Bench, hostname="127.0.0.1", port=0)
    announce(f"127.0.0.1:{server.port}")
    server.start()


def _connected(host: str, port: int) -> rpyc.Connection:
    """A connection; the server knows its port a little before it listens."""
    while True:
        try:
            return rpyc.connect(host, port, config={"sync_request_timeout": 60})
        except ConnectionRefusedError:
            time.sleep(0.002)


def connect(place: str, options: list[str]) -> Caller:
    host, port = place.split(":")
    connection = _connected(host, int(port))
    return Caller(connection.root.add, connection.root.echo)
