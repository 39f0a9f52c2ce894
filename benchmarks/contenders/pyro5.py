"""Pyro5: remote objects, blocking, serialized by serpent, which is its default."""

from __future__ import annotations

import Pyro5.api
import serpent

from benchmarks.harness.contender import Announce, Caller


@Pyro5.api.expose
class Bench:
    """What is offered."""

    def add(self, a: int, b: int) -> int:
        return a + b

    def echo(self, data: dict[str, str]) -> bytes:
        return bytes(serpent.tobytes(data))


def serve(announce: Announce, options: list[str]) -> None:
    daemon = Pyro5.api.Daemon(host="127.0.0.1")
    announce(str(daemon.register(Bench, "bench")))
    daemon.requestLoop()


def connect(place: str, options: list[str]) -> Caller:
    proxy = Pyro5.api.Proxy(place)
    return Caller(proxy.add, proxy.echo, data_in=lambda answer: bytes(serpent.tobytes(answer)))
