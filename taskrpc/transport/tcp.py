"""The network of real processes: sockets, and the registry of this machine."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import os
import socket
import ssl
from collections.abc import Sequence

from taskrpc.errors import AuthenticationFailed, CannotListen, TaskRpcError
from taskrpc.transport.entries import Change, Entry, Roster
from taskrpc.transport.listening import BACKLOG, Listener
from taskrpc.transport.network import Address, Factory
from taskrpc.transport.registry import Registry
from taskrpc.transport.tls import Tls, pinned_context, shown_certificate

log = logging.getLogger("taskrpc.transport")

POLL = 0.04
"""Seconds between two looks at the registry, while somebody waits for a change."""

_MAX_DOMAIN = 232


class TcpNetwork:
    """TCP on this machine's loopback, or wherever `listen` and `peers` say.

    `listen` is `host:port` (port 0: any free one). `peers` are `host:port` of processes on other
    machines; without them the registry of this machine is asked.
    """

    def __init__(
        self,
        *,
        domain: int,
        listen: str | None = None,
        peers: Sequence[str] = (),
        token: bytes | None = None,
        tls: Tls | None = None,
    ) -> None:
        self._tls = tls
        self.certificate = shown_certificate(tls)
        self.domain = domain
        self.token = token or os.urandom(32)
        self._peers = [_checked_place(peer) for peer in peers]
        self._peer_token = token
        self._listen_at = listen or "127.0.0.1:0"
        self._registry = Registry(domain)
        self._listener: Listener | None = None
        self._seen: object = None
        self._looked = float("-inf")

    def listen(self, factory: Factory) -> str:
        """Take connections from now on."""
        host, port = split_place(self._listen_at)
        self._refuse_unprotected(host)
        # A node that has no certificate of its own uses TLS for calling only.
        context = self._tls.server_context() if self._tls and self.certificate else None
        # Bound here and now, so that the address can be announced before the loop's next turn;
        # callers who are quicker than the loop wait in the backlog.
        sock = bound(host, port)
        self._listener = Listener(sock, factory, lambda: context)
        return join_place(*sock.getsockname()[:2])

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect."""
        host, port = split_place(address.place)
        context = self._context(address)
        _refuse_stranger(address, host, encrypted=context is not None)
        loop = asyncio.get_running_loop()
        _, protocol = await loop.create_connection(factory, host, port, ssl=context)
        return protocol

    def publish(self, roster: Roster, change: Change, *, claim: str = "") -> None:
        """Tell everybody on this machine of a change to what this process has."""
        self._registry.publish(roster, change, claim=claim)

    def locate(self, service: str) -> list[Address]:
        """Whom to ask for a service."""
        if self._peers:
            return self.peers()
        return [
            _address(roster.about, surely_offers=True)
            for roster in self._registry.rosters()
            if roster.about.address and roster.offers(service)
        ]

    def entries(self) -> list[Entry]:
        """What the registry knows; with peers given, only what is this process's."""
        entries = self._registry.entries()
        return [each for each in entries if each.pid == os.getpid()] if self._peers else entries

    def peers(self) -> list[Address]:
        """The processes that were named."""
        if not self._peers:
            return []
        # A peer on this machine, of this user, is in the registry with all that it wants.
        here = [_address(roster.about) for roster in self._registry.rosters()]
        known = {each.place: each for each in here if each.place}
        given = self._peer_token or b""
        return [known.get(place) or Address(place, given) for place in self._peers]

    def mark(self) -> object:
        """What the registry looked like at most a moment ago."""
        # An older look is a safe mark: at worst it makes somebody look twice.
        now = asyncio.get_running_loop().time()
        if now - self._looked >= POLL / 2:
            self._seen, self._looked = self._registry.signature(), now
        return self._seen

    async def changed(self, mark: object) -> None:
        """Return when the registry looks different from the mark."""
        # A watcher per platform would be quicker, but this runs only while somebody waits.
        while self.mark() == mark:  # noqa: ASYNC110 - other processes set no Event
            await asyncio.sleep(POLL)

    async def stop_listening(self) -> None:
        """Take no more connections."""
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()

    def close(self) -> None:
        """Remove this process's registry entry."""
        self._registry.close()

    def _refuse_unprotected(self, host: str) -> None:
        if not is_loopback(host) and not (self.certificate and self._peer_token):
            raise CannotListen(
                f"cannot listen at {host}: beyond this machine's own addresses (127.0.0.1,"
                " localhost, ::1) a certificate (tls) and a token are needed"
            )

    def _context(self, address: Address) -> ssl.SSLContext | None:
        """TLS as the registry says; for peers elsewhere, as this node was told."""
        if address.certificate:
            return pinned_context(address.certificate, self._tls)
        if address.certificate is None and self._tls is not None:
            return self._tls.client_context()
        return None


def _refuse_stranger(address: Address, host: str, *, encrypted: bool) -> None:
    """Send nothing in plain where others could read it."""
    if not encrypted and not is_loopback(host):
        raise AuthenticationFailed(
            f"{address.place} is another machine: calls there need TLS (tls) and its secret"
        )


def _address(entry: Entry, *, surely_offers: bool = False) -> Address:
    """Where another process of this machine reaches an entry's."""
    place = entry.address
    for everywhere, here in (("0.0.0.0:", "127.0.0.1:"), ("[::]:", "[::1]:")):
        place = place.replace(everywhere, here) if place.startswith(everywhere) else place
    token = bytes.fromhex(entry.token)
    return Address(place, token, surely_offers=surely_offers, certificate=entry.certificate)


def domain_id() -> int:
    """`ROS_DOMAIN_ID`, 0 where it is not set. Raises TaskRpcError for anything but 0 to 232."""
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > _MAX_DOMAIN:
        raise TaskRpcError(
            f"ROS_DOMAIN_ID: expected a number from 0 to {_MAX_DOMAIN}, got {text!r}"
        )
    return int(text)


def environment_peers() -> list[str]:
    """`TASKRPC_PEERS`: `host:port`, separated by commas, semicolons or spaces."""
    text = os.environ.get("TASKRPC_PEERS", "")
    return text.replace(",", " ").replace(";", " ").split()


def split_place(place: str) -> tuple[str, int]:
    """Host and port of `host:port` (IPv6 in brackets). Raises TaskRpcError."""
    host, colon, port = place.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > 65535 or not host:
        raise TaskRpcError(f"expected HOST:PORT such as 127.0.0.1:7450, got {place!r}")
    return host.strip("[]"), int(port)


def _checked_place(place: str) -> str:
    return join_place(*split_place(place))


def join_place(host: str, port: int) -> str:
    """The `host:port` of a host and a port."""
    host = "127.0.0.1" if host == "localhost" else host
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def is_loopback(host: str) -> bool:
    """Whether only programs of this machine can reach a host."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def bound(host: str, port: int) -> socket.socket:
    """A listening socket. Raises CannotListen."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Said in so many words: without it asyncio leaves Nagle's algorithm on where it accepts, and
    # a second write in a row waits 40 ms for the peer's acknowledgement.
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if os.name == "posix":
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((host, port))
        sock.listen(BACKLOG)
        sock.setblocking(False)
    except OSError as error:
        sock.close()
        reason = error.strerror or str(error)
        raise CannotListen(f"cannot listen at {join_place(host, port)}: {reason}") from None
    return sock
