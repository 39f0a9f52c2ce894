"""The programs that a command calls: those of this machine, or a remote one (`--connect`)."""

from __future__ import annotations

import os

from taskrpc.cli.shared.command import hinted
from taskrpc.errors import AuthenticationFailed, TaskRpcError

# Parsing a command line needs only the options below. Modules for calls, above all asyncio, are
# imported where a call is made.
TYPE_CHECKING = False
if TYPE_CHECKING:
    import argparse

    from taskrpc import Tls
    from taskrpc.node import Node
    from taskrpc.spi import Lab, Listing

LISTING_TIMEOUT = 4.0
"""Seconds that a program gets to list its services."""


class Remote:
    """The address to call, and the secrets for it; by default the programs of this machine.

    Attributes:
        address: `host:port` or `unix:/path` of one program; "" for all that the transport finds.
        transport, peers, tls, token: as `Node` takes them.
    """

    def __init__(
        self,
        address: str = "",
        tls: Tls | None = None,
        token: str | None = None,
        transport: str = "tcp",
    ) -> None:
        # Only TCP calls one program by its address. Elsewhere the address is that of a router.
        self.address = address if transport == "tcp" else ""
        self.transport = transport
        self.peers = [address] if address else None
        self.tls = tls
        self.token = token

    @property
    def addresses(self) -> list[str]:
        """The addresses to call in addition to those in the registry of this machine."""
        from taskrpc.spi import environment_peers

        if self.transport != "tcp":
            return []
        if self.address:
            return [self.address]
        lab = called_lab()
        return environment_peers() or ([] if lab is None else [lab.address])

    def node(self, *, name: str = "") -> Node:
        """Return a node for a command; without a `name` it gets a hidden one."""
        from taskrpc.node import Node

        return Node(
            name or f"_taskrpc_cli_{os.getpid()}",
            namespace="/",  # on a command line, names are absolute as in listings
            transport=self.transport,
            peers=self.peers,
            tls=self.tls,
            token=self.token,
        )

    async def listing(self, address: str) -> Listing:
        """Return the services and topics of the program at HOST:PORT.

        Raises AuthenticationFailed, ProtocolError, ConnectionLost, or the program's own error.
        """
        from taskrpc.spi import Endpoint, Resolve, TcpNetwork, domain_id, remembered_lab

        token = self.token or os.environ.get("TASKRPC_TOKEN") or ""
        secret, lab = token.encode() or None, remembered_lab()
        network = TcpNetwork(
            domain=domain_id(), peers=[address], token=secret, tls=self.tls, lab=lab
        )
        endpoint = Endpoint(network)
        try:
            deadline = endpoint.loop.time() + LISTING_TIMEOUT
            connection = await endpoint.dialler.connection(network.peers()[0], deadline)
            found: Listing = await connection.resolve(Resolve(""), deadline).future
            return found
        except AuthenticationFailed as error:
            hint = f"give the secret of {address} with --token-file or TASKRPC_TOKEN"
            has_hint = bool(getattr(error, "__notes__", ()))
            raise error if has_hint else hinted(error, hint) from None
        finally:
            await endpoint.release()


HERE = Remote()
"""The programs of this machine."""


def called_lab() -> Lab | None:
    """Return the joined lab if this user's programs call it; `TASKRPC_PEERS` replaces it.

    Raises TaskRpcError if the file of the lab is invalid.
    """
    from taskrpc.spi import environment_peers, remembered_lab

    return None if environment_peers() else remembered_lab()


def add_connect(parser: argparse.ArgumentParser) -> None:
    """Give a command `--connect`, `--transport`, and the options for the secrets."""
    group = parser.add_argument_group("a program on another machine")
    what = "Use the program there (or at unix:/path), not those of this machine"
    group.add_argument("--connect", metavar="HOST:PORT", type=any_address, help=what)
    add_transport(group)
    add_secrets(group)


def add_transport(group: argparse._ActionsContainer) -> None:
    """Give a command `--transport`."""
    what = "How programs find and call each other: tcp, ros or zenoh (default: tcp)"
    group.add_argument("--transport", metavar="NAME", default="tcp", help=what)


def add_discovery(parser: argparse.ArgumentParser, sim_time: str = "") -> None:
    """Accept ros2's options for its daemon and for simulated time.

    `sim_time` is the help text of `--use-sim-time`, for a command that measures time. For other
    commands the option does nothing.
    """
    from taskrpc.cli.shared.parsing import add_ignored

    add_ignored(parser, "--no-daemon", action="store_true")
    add_ignored(parser, "--spin-time", metavar="SECONDS", type=float)
    if sim_time:
        parser.add_argument("-s", "--use-sim-time", action="store_true", help=sim_time)
    else:
        add_ignored(parser, "-s", "--use-sim-time", action="store_true")


def address(text: str) -> str:
    """Return a valid `HOST:PORT` argument. Raises argparse's ArgumentTypeError."""
    from argparse import ArgumentTypeError

    from taskrpc.spi import split_address

    try:
        split_address(text)
    except TaskRpcError as error:
        raise ArgumentTypeError(str(error)) from None
    return text


def any_address(text: str) -> str:
    """Return a valid `HOST:PORT` or `unix:/path`. Raises argparse's ArgumentTypeError."""
    if not text.startswith("unix:"):
        return address(text)
    from argparse import ArgumentTypeError

    from taskrpc.spi import checked_unix

    try:
        return text if text == "unix:" else checked_unix(text)
    except TaskRpcError as error:
        raise ArgumentTypeError(str(error)) from None


def add_secrets(group: argparse._ActionsContainer) -> None:
    """Give a command the options for the token and the certificates."""
    what = "A file with the token of that program (or set TASKRPC_TOKEN)"
    group.add_argument("--token-file", metavar="FILE", help=what)
    what = "The certificate of the authority that signed that program's certificate (PEM)"
    group.add_argument("--tls-ca", metavar="FILE", help=what)
    group.add_argument("--tls-cert", metavar="FILE", help="The certificate of this client (PEM)")
    group.add_argument("--tls-key", metavar="FILE", help="Its key")


def remote_of(options: argparse.Namespace) -> Remote:
    """Return the address and secrets in the options.

    Raises TaskRpcError for a file that cannot be read.
    """
    address = getattr(options, "connect", None) or ""  # taskrpc-server has no --connect
    transport = getattr(options, "transport", "tcp")  # doctor and the gateways have no --transport
    return Remote(address, _tls(options), _token(options.token_file), transport)


def _tls(options: argparse.Namespace) -> Tls | None:
    files = options.tls_cert, options.tls_key, options.tls_ca
    if not any(files):
        return None
    from taskrpc import Tls

    return Tls(*files)


def _token(file: str | None) -> str | None:
    if not file:
        return None
    from taskrpc.spi import private_files

    try:
        with open(file, encoding="utf-8") as opened:
            private_files.check_private(opened.fileno(), file)
            token = opened.read().strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "expected UTF-8 text"
        raise TaskRpcError(f"--token-file {file}: {reason}") from None
    if not token:
        raise TaskRpcError(f"--token-file {file}: the file is empty")
    return token
