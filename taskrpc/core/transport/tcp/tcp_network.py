"""The network of real processes: TCP, TLS and Unix sockets, and the registry of this machine."""

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

from taskrpc.core.security.lab import Lab
from taskrpc.core.security.roles import account_of
from taskrpc.core.security.tls import ServerTls, Tls, common_name, digest, pinned_context
from taskrpc.core.system import os_errors
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.discovery.registry import Registry
from taskrpc.core.transport.network import Address, Factory
from taskrpc.core.transport.settings import Settings
from taskrpc.core.transport.tcp.unix_sockets import (
    PREFIX,
    bound_unix,
    checked_unix,
    is_unix,
    path_of,
    remove_unix,
    unix_peer_credentials,
)
from taskrpc.core.wire.handshake import PeerCredentials
from taskrpc.errors import AuthenticationFailed, CannotListen, TaskRpcError

if TYPE_CHECKING:
    from taskrpc.core.security.accounts import AccountSource
    from taskrpc.core.transport.tcp.listening import Listener

log = logging.getLogger("taskrpc.transport")

POLL = 0.04
"""Seconds between two looks at the registry while a client waits for a service."""

SLOW_POLL = 0.1
"""The same while only subscriptions wait; they wait as long as they exist."""

ENTRY_CHECK = 2.0
"""Seconds between two checks that the files with which others find this program are still there."""


class TcpNetwork:
    """TCP on this machine's loopback, or at the addresses of `listen` and `peers`.

    `listen` is `host:port`; port 0 means any free port. `peers` are `host:port` of processes on
    other machines. Without peers, the network finds processes in the registry of this machine, then
    at the `lab`. Both accept `unix:/path`; `listen="unix:"` creates a socket in the runtime folder.
    """

    native = None
    problem = ""
    discovery_ends = 0.0
    default_address = "127.0.0.1:0"
    """Where programs listen that choose no address; "unix:" in a process without TCP."""

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
        # A node without a certificate of its own uses TLS only for its calls.
        unencrypted = tls is None or tls.cert is None or is_unix(listen or "")
        self._server_tls = None if tls is None or unencrypted else ServerTls(tls)
        self.accounts = accounts
        self.domain = domain
        self.token = token or os.urandom(32)
        self._peers = [_checked_address(peer) for peer in peers]
        self._peer_token = token
        """The token that the user gave; None if `token` is a random one."""
        self._listen_at = listen or self.default_address
        self._registry = Registry(domain)
        self._listener: Listener | None = None
        self._remove_socket: Callable[[], object] = lambda: None
        self._socket_file = ""
        """The path of the Unix socket at which it listens; "" for none, and after its removal."""
        self._entry_check: asyncio.TimerHandle | None = None
        self._seen: object = None
        """The registry's signature when it was read last, at `_looked` on the loop's clock."""
        self._looked = float("-inf")

    @property
    def uses_registry(self) -> bool:
        """Whether it finds programs in the registry of this machine: only without peers."""
        return not self._peers

    async def open(self) -> None:
        """Begin to check that other programs can still find this one."""
        if self._entry_check is None:
            self._check_entry()

    def listen(self, factory: Factory) -> str:
        """Accept connections from now on; return the address. Raises CannotListen."""
        from taskrpc.core.transport.tcp.listening import Listener  # many programs only call

        if is_unix(self._listen_at):
            name = f"{os.getpid()}-{id(self):x}.sock"
            sock, path, made = bound_unix(self._listen_at, name)
            self._remove_socket = partial(remove_unix, path, made)
            self._listener = Listener(sock, factory)
            self._socket_file = path
            return PREFIX + path
        host, port = split_address(self._listen_at)
        if not is_loopback(host):
            from taskrpc.core.security.listen_policy import check_listen_policy

            check_listen_policy(
                host,
                certificate=self.certificate != "",
                token=(self._peer_token or b"").decode(),
                accounts=None if self.accounts is None else self.accounts.current,
                ca=self._tls is not None and self._tls.ca is not None,
            )
        tls = self._server_tls
        # Bound at once, so that the address can be announced before the next turn of the loop.
        # Connections that arrive earlier wait in the kernel's backlog.
        try:
            sock = listening_socket(host, port)
        except CannotListen as error:
            if port:
                error.add_note("if another program has this port, `taskrpc ps` may show it: end it")
            raise
        self._listener = Listener(sock, factory, tls.context if tls else lambda: None)
        return join_address(*sock.getsockname()[:2])

    async def dial(self, address: Address, factory: Factory) -> asyncio.BaseProtocol:
        """Connect. Raises OSError, or AuthenticationFailed for a plain call to another machine."""
        loop = asyncio.get_running_loop()
        if is_unix(address.text):
            path = path_of(address.text)
            _, protocol = await loop.create_unix_connection(factory, path)
            return protocol
        host, port = split_address(address.text)
        context = self._context(address)
        _refuse_plain_call(address, host, encrypted=context is not None)
        _, protocol = await loop.create_connection(factory, host, port, ssl=context)
        return protocol

    @property
    def certificate(self) -> str:
        """The current certificate (PEM), "" for plain connections."""
        if self._server_tls is None:
            return ""
        self._server_tls.context()  # reads the files again if they have changed
        return self._server_tls.certificate

    def peer_credentials(
        self, transport: asyncio.BaseTransport, *, serving: bool
    ) -> PeerCredentials | None:
        """What a connection itself proves about the peer. Raises PermissionDenied."""
        sock = transport.get_extra_info("socket")
        if sock is not None and sock.family == getattr(socket, "AF_UNIX", None):
            return unix_peer_credentials(
                sock, serving=serving, has_accounts=self.accounts is not None
            )
        if not serving:
            # TLS has checked the server. It can check this client if the client has a certificate.
            encrypted = transport.get_extra_info("ssl_object") is not None
            return PeerCredentials("") if encrypted and self._tls and self._tls.key else None
        certificate = transport.get_extra_info("peercert")
        if not certificate or (self._peer_token and self.accounts is None):
            return None  # without accounts, a configured token is required besides a certificate
        return PeerCredentials(common_name(certificate))

    def channel_binding(self, transport: asyncio.BaseTransport, *, serving: bool) -> bytes:
        """The digest of the server's certificate, b"" for a plain connection."""
        encrypted = transport.get_extra_info("ssl_object")
        if encrypted is None:
            return b""
        if not serving:
            return digest(encrypted.getpeercert(binary_form=True))
        assert self._server_tls is not None, "an encrypted connection without server TLS"
        return self._server_tls.shown_with(encrypted.context)

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Publish a change in the registry. Raises NameInUse if another process has the `claim`."""
        self._registry.publish(tracked, change, claim=claim)

    def locate(self, service: str) -> list[Address]:
        """The processes to ask for a service: those in the registry first, then the peers."""
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
        """Other processes that publish some of these topics, or must be asked; with the topics."""
        found: list[tuple[Address, Collection[str]]] = [(peer, topics) for peer in self.peers()]
        if not self._peers:
            for tracked in self._registry.others():
                if tracked.about.address:
                    there = [topic for topic in topics if tracked.publishes(topic)]
                    found += [(_address(tracked.about), there)] if there else []
        return found

    def entries(self) -> list[RegistryEntry]:
        """The entries of the registry; with peers configured, only that of this process."""
        entries = self._registry.entries()
        return [each for each in entries if each.pid == os.getpid()] if self._peers else entries

    def peers(self) -> list[Address]:
        """The configured peers, else the lab."""
        lab = [] if self._lab is None else [self._lab]
        if not self._peers:
            return lab
        # The registry knows token and certificate of a peer of the same user on this machine.
        here = [_address(tracked.about) for tracked in self._registry.tracked_entries()]
        known = {each.text: each for each in [*lab, *here] if each.text}
        given = self._peer_token or b""
        if account_of(given):  # with the token of an account, calls are made as this account
            known = {address: replace(each, token=given) for address, each in known.items()}
        return [known.get(address) or Address(address, given) for address in self._peers]

    def address_of(self, entry: RegistryEntry) -> Address:
        """The address of a process in the registry."""
        return _address(entry)

    def mark(self) -> object:
        """The state of the registry, at most half a `POLL` old, for `changed`."""
        # An old mark is safe: at worst, the caller looks at the registry once too often.
        now = asyncio.get_running_loop().time()
        if now - self._looked >= POLL / 2:
            self._seen, self._looked = self._registry.signature(), now
        return self._seen

    async def changed(self, mark: object, polls_fast: Callable[[], bool]) -> None:
        """Return once the registry differs from the mark."""
        # Polling is simpler than a file watcher for each system, and needed only while waiting.
        while self.mark() == mark:  # noqa: ASYNC110 - other processes set no Event
            await asyncio.sleep(POLL if polls_fast() else SLOW_POLL)

    async def stop_listening(self) -> None:
        """Accept no more connections."""
        self._socket_file = ""
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()
            self._remove_socket()

    def close(self) -> None:
        """Remove this process's registry entry."""
        if self._entry_check is not None:
            self._entry_check.cancel()
        self._registry.close()

    def _check_entry(self) -> None:
        """Write the registry entry again if it was removed, as by `rm -rf` or a cleaner of /tmp."""
        self._entry_check = asyncio.get_running_loop().call_later(ENTRY_CHECK, self._check_entry)
        self._registry.keep_entry()
        if self._socket_file and not os.path.lexists(self._socket_file):
            text = "the socket %s was removed: no program can call this one until it is restarted"
            log.warning(text, self._socket_file)
            self._socket_file = ""

    def _context(self, address: Address) -> ssl.SSLContext | None:
        """TLS by the registry's certificate; for peers elsewhere, by this node's settings."""
        if address.certificate:
            return pinned_context(address.certificate, self._tls)
        if address.certificate is None and self._tls is not None:
            return self._tls.client_context()
        return None


def open_network(settings: Settings) -> TcpNetwork:
    """Return the network of a program with these settings. Raises TaskRpcError."""
    return TcpNetwork(
        domain=settings.domain,
        listen=settings.listen,
        peers=settings.peers,
        token=settings.token,
        tls=settings.tls,
        lab=settings.lab,
        accounts=settings.account_source(),
    )


def _refuse_plain_call(address: Address, host: str, *, encrypted: bool) -> None:
    """Raise AuthenticationFailed for a plain connection to another machine."""
    if not encrypted and not is_loopback(host):
        raise AuthenticationFailed(
            f"{address.text} is another machine: calls there need TLS (tls) and its secret"
        )


def _address(entry: RegistryEntry) -> Address:
    """The address at which processes of this machine reach the process of an entry."""
    address, token = address_here(entry.address), bytes.fromhex(entry.token)
    return Address(
        address, token, certificate=entry.certificate, pid=entry.pid, script=entry.script
    )


def address_here(address: str) -> str:
    """Return the address at which this machine reaches a server that listens to all networks."""
    for everywhere, here in (("0.0.0.0:", "127.0.0.1:"), ("[::]:", "[::1]:")):
        if address.startswith(everywhere):
            return address.replace(everywhere, here, 1)
    return address


def _address_of_lab(lab: Lab) -> Address:
    token, certificate = lab.token.encode(), lab.certificate
    return Address(lab.address, token, certificate=certificate, domain=lab.domain)


def split_address(address: str) -> tuple[str, int]:
    """Return host and port of `host:port` (IPv6 in brackets). Raises TaskRpcError."""
    host, colon, port = address.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > 65535 or not host:
        raise TaskRpcError(f"expected HOST:PORT such as 127.0.0.1:7450, got {address!r}")
    return host.strip("[]"), int(port)


def _checked_address(address: str) -> str:
    if is_unix(address):
        return checked_unix(address)
    return join_address(*split_address(address))


def join_address(host: str, port: int) -> str:
    """Return `host:port`, with brackets for IPv6."""
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


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a listening socket. Raises CannotListen."""
    from taskrpc.core.transport.tcp.listening import BACKLOG

    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # IPPROTO_TCP must be explicit. Otherwise asyncio leaves Nagle's algorithm on for accepted
    # connections, and a second write in a row waits 40 ms for the peer's acknowledgement.
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if os.name == "posix":
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((host, port))
        sock.listen(BACKLOG)
        sock.setblocking(False)
    except OSError as error:
        sock.close()
        address, reason = join_address(host, port), os_errors.reason_of(error)
        raise CannotListen(f"cannot listen at {address}: {reason}") from None
    return sock
