"""One endpoint for all nodes of an event loop that want the same network."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taskrpc.errors import TaskRpcError
from taskrpc.security.lab import Lab, remembered_lab
from taskrpc.security.roles import Accounts
from taskrpc.security.tls import Tls
from taskrpc.transport.base import Transport
from taskrpc.transport.endpoint import Endpoint
from taskrpc.transport.limits.keepalive import keepalive_of
from taskrpc.transport.network import Network
from taskrpc.transport.tcp.tcp_network import TcpNetwork, domain_id, environment_peers

if TYPE_CHECKING:
    from taskrpc.security.accounts import AccountSource

_endpoints: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, dict[Hashable, Endpoint]] = (
    weakref.WeakKeyDictionary()
)


def shared_transport(
    name: str,
    *,
    listen: str | None,
    peers: Sequence[str] | None,
    token: str | None,
    tls: Tls | None,
    accounts: Accounts | str | Path | None = None,
    keepalive: str | None = None,
    threads: bool = False,
    domain: int | None = None,
) -> Transport:
    """The running loop's endpoint for these settings, made for the first who asks.

    `release()` it when done. `threads` says that other threads than the loop's call.

    Raises TaskRpcError for an unknown name or wrong setting.
    """
    domain = domain_id() if domain is None else domain
    where = tuple(environment_peers() if peers is None else _listed(peers))
    lab = remembered_lab() if name == "tcp" else None
    endpoints = _endpoints.setdefault(asyncio.get_running_loop(), {})
    profile = keepalive_of(keepalive)
    key = (name, domain, listen, where, token, tls, lab, accounts, profile)
    endpoint = endpoints.get(key)
    if endpoint is None:
        secret = token.encode() if token else None
        source = None if accounts is None else _account_source(accounts)
        network = _network(name, domain, listen, where, secret, tls, lab, source)
        # An endpoint holds its loop: one that stayed here would keep the loop alive for ever.
        forget = lambda: endpoints.pop(key)  # noqa: E731
        endpoints[key] = endpoint = Endpoint(network, forget, keepalive=profile, threads=threads)
    else:
        endpoint.holders += 1
    return endpoint


def lab_namespace(name: str, peers: Sequence[str] | None) -> str:
    """The namespace of a node that says none: the joined lab's where it calls the lab, else "".

    Raises TaskRpcError for a lab's file that says something else.
    """
    if name != "tcp" or peers is not None or environment_peers():
        return ""
    lab = remembered_lab()
    return "" if lab is None else lab.namespace


def _network(
    name: str,
    domain: int,
    listen: str | None,
    peers: Sequence[str],
    token: bytes | None,
    tls: Tls | None,
    lab: Lab | None,
    accounts: AccountSource | None,
) -> Network:
    if name == "tcp":
        return TcpNetwork(
            domain=domain,
            listen=listen,
            peers=peers,
            token=token,
            tls=tls,
            lab=lab,
            accounts=accounts,
        )
    if name == "memory":
        from taskrpc.transport.memory import MemoryNetwork

        return MemoryNetwork(domain=domain, program=listen or "", token=token, accounts=accounts)
    raise TaskRpcError(f"transport: expected 'tcp' or 'memory', got {name!r}")


def _account_source(accounts: Accounts | str | Path) -> AccountSource:
    from taskrpc.security.accounts import AccountSource  # few programs have accounts

    return AccountSource(accounts)


def _listed(peers: Sequence[str]) -> Sequence[str]:
    """A single peer is easily written without its list, and is a sequence of letters then."""
    return [peers] if isinstance(peers, str) else peers
