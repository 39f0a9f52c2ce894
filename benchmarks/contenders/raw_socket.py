"""The floor: blocking sockets, a thread a connection, and nothing else."""

from __future__ import annotations

import socket
import threading

from benchmarks.harness.contender import Announce, Caller

_LENGTH = 4
_TWO_INTS = bytes(16)
_READ = 65_536


class _Framed:
    """A socket that sends and receives frames behind four bytes of length."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = sock

    def send(self, body: bytes) -> None:
        self._socket.sendall(len(body).to_bytes(_LENGTH, "little") + body)

    def receive(self) -> bytes:
        """The next frame, b"" at the end. No more than one is ever on its way."""
        data = self._socket.recv(_READ)
        if not data:
            return b""
        size = int.from_bytes(data[:_LENGTH], "little")
        if len(data) == _LENGTH + size:
            return data[_LENGTH:]
        body = bytearray(size)
        begun = len(data) - _LENGTH
        body[:begun] = data[_LENGTH:]
        room = memoryview(body)[begun:]
        while room:
            room = room[self._socket.recv_into(room) :]
        return bytes(body)


def _echo(sock: socket.socket) -> None:
    peer = _Framed(sock)
    while body := peer.receive():
        peer.send(body)


def serve(announce: Announce, options: list[str]) -> None:
    server = socket.create_server(("127.0.0.1", 0), backlog=128)
    announce(f"127.0.0.1:{server.getsockname()[1]}")
    while True:
        sock, _ = server.accept()
        threading.Thread(target=_echo, args=[sock], daemon=True).start()


def connect(place: str, options: list[str]) -> Caller:
    host, port = place.split(":")
    peer = _Framed(socket.create_connection((host, int(port))))

    def call(body: bytes) -> bytes:
        peer.send(body)
        return peer.receive()

    return Caller(add=lambda a, b: call(_TWO_INTS), echo=call)
