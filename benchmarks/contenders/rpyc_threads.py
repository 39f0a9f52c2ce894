"""RPyC: remote objects, blocking, a thread a connection; the methods are looked up once."""

from __future__ import annotations

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


def connect(place: str, options: list[str]) -> Caller:
    host, port = place.split(":")
    connection = rpyc.connect(host, int(port), config={"sync_request_timeout": 60})
    return Caller(connection.root.add, connection.root.echo)
