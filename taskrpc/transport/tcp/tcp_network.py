"""The network of real processes: sockets, and the registry of this machine."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import os
import socket
import ssl
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import TYPE_CHECKING

from msgspec.structs import replace

from taskrpc import platform
from taskrpc.errors import AuthenticationFailed, CannotListen, TaskRpcError
from taskrpc.security.lab import Lab
from taskrpc.security.roles import account_of
from taskrpc.security.tls import ServerTls, Tls, common_name, digest, pinned_context
from taskrpc.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.transport.discovery.registry import Registry
from taskrpc.transport.network import Address, Factory
from taskrpc.transport.tcp.unix_sockets import (
    PREFIX,
    bound_unix,
    checked_unix,
    is_unix,
    path_of,
    remove_unix,
    unix_peer_credentials,
)
from taskrpc.wire.handshake import PeerCredentials

if TYPE_CHECKING:
    from taskrpc.security.accounts import AccountSource
    from taskrpc.transport.tcp.listening import Listener

log = logging.getLogger("taskrpc.transport")

POLL = 0.04
"""Seconds between two looks at the registry, while somebody waits for a change."""

SLOW_POLL = 0.1
"""The same while only subscriptions wait, which always do."""

_MAX_DOMAIN = 232


class TcpNetwork:
    """TCP on this machine's loopback, or wherever `listen` and `peers` say.

    `listen` is `host:port` (port 0: any free one). `peers` are `host:port` of processes on other
    machines; without them the registry of this machine is asked, and then the `lab`. Either may be
    `unix:/path`; to listen at `unix:` alone makes a socket in the runtime folder.
    """

    def __init__(
        self,
        *,
        domain: int,
        listen: str | None = None,
        peers: Sequence[str] = (),
        token: bytes | None = None,
        tls: Tls | None = None,
        lab: Lab | None = None,
        accounts: AccountSource | None = None,
    ) -> None:
        self._tls = tls
        self._lab = None if lab is None else _address_of_lab(lab)
        # A node that has no certificate of its own uses TLS for calling only.
        unencrypted = tls is None or tls.cert is None or is_unix(listen or "")
        self._server_tls = None if tls is None or unencrypted else ServerTls(tls)
        self.accounts = accounts
        self.domain = domain
        self.token = token or os.urandom(32)
        self._peers = [_checked_place(peer) for peer in peers]
        self._peer_token = token
        self._listen_at = listen or "127.0.0.1:0"
        self._registry = Registry(domain)
        self._listener: Listener | None = None
        self._remove_socket: Callable[[], object] = lambda: None
        self._seen: object = None
        self._looked = float("-inf")

    def listen(self, factory: Factory) -> str:
        """Take connections from now on."""
        from taskrpc.transport.tcp.listening import Listener  # many programs only call

        if is_unix(self._listen_at):
            name = f"{os.getpid()}-{id(self):x}.sock"
            sock, path, made = bound_unix(self._listen_at, name)
            self._remove_socket = partial(remove_unix, path, made)
            self._listener = Listener(sock, factory)
            return PREFIX + path
        host, port = split_place(self._listen_at)
        if not is_loopback(host):
            from taskrpc.security.listen_policy import check_listen_policy

            check_listen_policy(
                host,
                certificate=self.certificate != "",
                token=(self._peer_token or b"").decode(),
                accounts=None if self.accounts is None else self.accounts.current,
                ca=self._tls is not None and self._tls.ca is not None,
            )
        tls = self._server_tls
        # Bound here and now, so that the address can be announced before the loop's next turn;
        # callers who are quicker than the loop wait in the backlog.
        sock = bound(host, port)
        self._listener = Listener(sock, factory, tls.context if tls else lambda: None)
        return join_place(*sock.getsockname()[:2])

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect."""
        loop = asyncio.get_running_loop()
        if is_unix(address.place):
            path = path_of(address.place)
            _, protocol = await loop.create_unix_connection(factory, path)
            return protocol
        host, port = split_place(address.place)
        context = self._context(address)
        _refuse_stranger(address, host, encrypted=context is not None)
        _, protocol = await loop.create_connection(factory, host, port, ssl=context)
        return protocol

    @property
    def certificate(self) -> str:
        """What callers are shown now (PEM), "" where connections are plain."""
        if self._server_tls is None:
            return ""
        self._server_tls.context()  # its files may have changed
        return self._server_tls.certificate

    def peer_credentials(
        self, transport: asyncio.BaseTransport, *, serving: bool
    ) -> PeerCredentials | None:
        """What a connection proves of the other side by itself."""
        sock = transport.get_extra_info("socket")
        if sock is not None and sock.family == getattr(socket, "AF_UNIX", None):
            return unix_peer_credentials(
                sock, serving=serving, has_accounts=self.accounts is not None
            )
        if not serving:
            # All our contexts check the server; it can check us where we show a certificate.
            encrypted = transport.get_extra_info("ssl_object") is not None
            return PeerCredentials("") if encrypted and self._tls and self._tls.key else None
        certificate = transport.get_extra_info("peercert")
        if not certificate or (self._peer_token and self.accounts is None):
            return None  # a token that was given must be proved beside the certificate
        return PeerCredentials(common_name(certificate))

    def channel_binding(self, transport: asyncio.BaseTransport, *, serving: bool) -> bytes:
        """The digest of the certificate that the server showed, empty for a plain connection."""
        encrypted = transport.get_extra_info("ssl_object")
        if encrypted is None:
            return b""
        if not serving:
            return digest(encrypted.getpeercert(binary_form=True))
        assert self._server_tls is not None, "only then connections that come are encrypted"
        return self._server_tls.shown_with(encrypted.context)

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Tell everybody on this machine of a change to what this process has."""
        self._registry.publish(tracked, change, claim=claim)

    def locate(self, service: str) -> list[Address]:
        """Whom to ask for a service."""
        if self._peers:
            return self.peers()
        here = [
            replace(
                _address(tracked.about),
                surely_offers=True,
                type_hash=tracked.services[service].type_hash,
            )
            for tracked in self._registry.tracked_entries()
            if tracked.about.address and tracked.offers(service)
        ]
        return here + self.peers()

    def publishing(self, topics: Collection[str]) -> list[tuple[Address, Collection[str]]]:
        """Which other processes publish any of these topics, or must be asked."""
        found: list[tuple[Address, Collection[str]]] = [(peer, topics) for peer in self.peers()]
        if not self._peers:
            for tracked in self._registry.others():
                if tracked.about.address:
                    there = [topic for topic in topics if tracked.publishes(topic)]
                    found += [(_address(tracked.about), there)] if there else []
        return found

    def entries(self) -> list[RegistryEntry]:
        """What the registry knows; with peers given, only what is this process's."""
        entries = self._registry.entries()
        return [each for each in entries if each.pid == os.getpid()] if self._peers else entries

    def peers(self) -> list[Address]:
        """The processes that were named, else the lab."""
        lab = [] if self._lab is None else [self._lab]
        if not self._peers:
            return lab
        # A peer on this machine, of this user, is in the registry with all that it wants.
        here = [_address(tracked.about) for tracked in self._registry.tracked_entries()]
        known = {each.place: each for each in [*lab, *here] if each.place}
        given = self._peer_token or b""
        if account_of(given):  # who gives an account's token wants to be that account
            known = {place: replace(each, token=given) for place, each in known.items()}
        return [known.get(place) or Address(place, given) for place in self._peers]

    def mark(self) -> object:
        """What the registry looked like at most a moment ago."""
        # An older look is a safe mark: at worst it makes somebody look twice.
        now = asyncio.get_running_loop().time()
        if now - self._looked >= POLL / 2:
            self._seen, self._looked = self._registry.signature(), now
        return self._seen

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return when the registry looks different from the mark."""
        # A watcher per platform would be quicker, but this runs only while somebody waits.
        while self.mark() == mark:  # noqa: ASYNC110 - other processes set no Event
            await asyncio.sleep(POLL if polls_fast() else SLOW_POLL)

    async def stop_listening(self) -> None:
        """Take no more connections."""
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()
            self._remove_socket()

    def close(self) -> None:
        """Remove this process's registry entry."""
        self._registry.close()

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


def _address(entry: RegistryEntry) -> Address:
    """Where another process of this machine reaches an entry's."""
    place = entry.address
    for everywhere, here in (("0.0.0.0:", "127.0.0.1:"), ("[::]:", "[::1]:")):
        place = place.replace(everywhere, here) if place.startswith(everywhere) else place
    token = bytes.fromhex(entry.token)
    return Address(place, token, certificate=entry.certificate, pid=entry.pid, script=entry.script)


def _address_of_lab(lab: Lab) -> Address:
    token, certificate = lab.token.encode(), lab.certificate
    return Address(lab.place, token, certificate=certificate, domain=lab.domain)


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
    if is_unix(place):
        return checked_unix(place)
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
    from taskrpc.transport.tcp.listening import BACKLOG

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
        place, reason = join_place(host, port), platform.reason_of(error)
        raise CannotListen(f"cannot listen at {place}: {reason}") from None
    return sock
