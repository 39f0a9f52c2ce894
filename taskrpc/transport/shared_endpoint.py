"""Shares one endpoint between the nodes of an event loop that have the same settings."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taskrpc.errors import TaskRpcError
from taskrpc.security.lab import remembered_lab
from taskrpc.security.roles import Accounts
from taskrpc.security.tls import Tls
from taskrpc.transport.base import Transport
from taskrpc.transport.endpoint import Endpoint
from taskrpc.transport.limits.keepalive import keepalive_of
from taskrpc.transport.network import Network
from taskrpc.transport.tcp.tcp_network import TcpNetwork, domain_id, environment_peers

if TYPE_CHECKING:
    from taskrpc.security.accounts import AccountSource
    from taskrpc.transport.connection.incoming_call import RouteFaults

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
    faults: RouteFaults | None = None,
) -> Transport:
    """Return the running loop's endpoint for these settings; the first call creates it.

    Each caller calls `release()` in the end. `threads`: other threads than the loop's make calls.
    `faults`: injects faults into incoming calls.
    Raises TaskRpcError for an unknown name or an invalid setting.
    """
    domain = domain_id() if domain is None else domain
    addresses = tuple(environment_peers() if peers is None else _listed(peers))
    lab = remembered_lab() if name == "tcp" else None
    endpoints = _endpoints.setdefault(asyncio.get_running_loop(), {})
    profile = keepalive_of(keepalive)
    key = (name, domain, listen, addresses, token, tls, lab, accounts, profile, faults)
    if (known := endpoints.get(key)) is not None:
        known.holders += 1
        return known
    secret = token.encode() if token else None
    source: AccountSource | None = None
    if accounts is not None:
        from taskrpc.security.accounts import AccountSource  # few programs have accounts

        source = AccountSource(accounts)
    network: Network
    if name == "tcp":
        network = TcpNetwork(
            domain=domain,
            listen=listen,
            peers=addresses,
            token=secret,
            tls=tls,
            lab=lab,
            accounts=source,
        )
    elif name == "memory":
        from taskrpc.transport.memory import MemoryNetwork

        program = listen or ""
        network = MemoryNetwork(domain=domain, program=program, token=secret, accounts=source)
    else:
        raise TaskRpcError(f"transport: expected 'tcp' or 'memory', got {name!r}")
    # An endpoint refers to its event loop: if it stayed here, the loop would never be freed.
    forget = lambda: endpoints.pop(key)  # noqa: E731
    endpoints[key] = endpoint = Endpoint(
        network, forget, keepalive=profile, threads=threads, faults=faults
    )
    return endpoint


def lab_namespace(name: str, peers: Sequence[str] | None) -> str:
    """Return the default namespace of a node: that of the joined lab if it calls the lab, else "".

    Raises TaskRpcError if the lab's file is invalid.
    """
    if name != "tcp" or peers is not None or environment_peers():
        return ""
    lab = remembered_lab()
    return "" if lab is None else lab.namespace


def _listed(peers: Sequence[str]) -> Sequence[str]:
    """The peers as a list; users may pass a single peer as a string, which is a sequence too."""
    return [peers] if isinstance(peers, str) else peers
