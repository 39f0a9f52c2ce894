"""The transports by name, and one endpoint for the nodes of an event loop with equal settings."""

from __future__ import annotations

import asyncio
import importlib
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

import msgspec

from taskrpc.core.current_program import current_program
from taskrpc.core.security.lab import remembered_lab
from taskrpc.core.security.roles import Accounts
from taskrpc.core.security.tls import Tls
from taskrpc.core.transport.endpoint import Endpoint
from taskrpc.core.transport.limits.keepalive import keepalive_of
from taskrpc.core.transport.network import Network, missing_names
from taskrpc.core.transport.settings import Settings, domain_id, environment_peers
from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from taskrpc.core.transport.connection.incoming_call import RouteFaults


class Registration(msgspec.Struct, frozen=True):
    """One transport of `TRANSPORTS`."""

    opener: str
    """`module:function`; the function takes `Settings` and returns a `Network`."""
    in_lab: bool = False
    """Whether its nodes call the lab of `taskrpc join`."""
    needs: str = ""
    """A module that is not part of taskrpc's dependencies."""
    advice: Callable[[], str] = str
    """Returns how to install `needs`."""
    package: str = ""
    """The installed package that adds it, "" for a transport of taskrpc."""


def _advice_for_zenoh() -> str:
    from taskrpc.core.security.installing import install_command  # few programs need it

    return install_command("zenoh", "eclipse-zenoh")


TRANSPORTS = {
    "tcp": Registration("taskrpc.core.transport.tcp.tcp_network:open_network", in_lab=True),
    "memory": Registration("taskrpc.core.transport.memory:open_network"),
    "ros": Registration("taskrpc.middleware.ros.ros_engine:open_network"),
    "zenoh": Registration(
        "taskrpc.middleware.zenoh.zenoh_engine:open_network",
        needs="zenoh",
        advice=_advice_for_zenoh,
    ),
}
"""The transports of taskrpc. Other packages add theirs as entry points; see `registered`."""
ENTRY_POINTS = "taskrpc.transports"
"""The group of entry points in which other packages list their transports."""

_Key: TypeAlias = tuple[str, Settings, object, object, str]
"""What nodes must have in common to share an endpoint; the last part is the program."""

_endpoints: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, dict[_Key, Endpoint]] = (
    weakref.WeakKeyDictionary()
)


def shared_endpoint(
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
) -> Endpoint:
    """Return the running loop's endpoint for these settings; the first call creates it.

    Each caller awaits `open()`, and calls `release()` in the end. `threads`: other threads than the
    loop's make calls. `faults`: injects faults into incoming calls.

    Raises TaskRpcError for an unknown name or an invalid setting.
    """
    registration = registered(name)
    settings = Settings(
        domain=domain_id() if domain is None else domain,
        listen=listen,
        peers=tuple(environment_peers() if peers is None else _listed(peers)),
        token=token.encode() if token else None,
        tls=tls,
        lab=remembered_lab() if registration.in_lab else None,
        accounts=accounts,
    )
    endpoints = _endpoints.setdefault(asyncio.get_running_loop(), {})
    profile = keepalive_of(keepalive)
    key: _Key = (name, settings, profile, faults, current_program.get())
    if (known := endpoints.get(key)) is not None:
        known.holders += 1
        return known
    network = _open(name, registration, settings)
    # An endpoint refers to its event loop: if it stayed here, the loop would never be freed.
    forget = lambda: endpoints.pop(key)  # noqa: E731
    endpoints[key] = endpoint = Endpoint(
        network, forget, keepalive=profile, threads=threads, faults=faults
    )
    return endpoint


async def close_program(program: str) -> None:
    """Close the endpoints of a program that has ended without closing its nodes.

    `program` is a value of `current_program`, for interpreters in which programs end one by one.
    """
    endpoints = _endpoints.get(asyncio.get_running_loop(), {})
    left = [endpoint for key, endpoint in endpoints.items() if key[-1] == program]
    for endpoint in left:
        endpoint.holders = 1
        await endpoint.release()


def registered(name: str) -> Registration:
    """Return the registration of a transport: ours, or that of an installed package.

    A package lists its transport in the group `taskrpc.transports` of its entry points. The value
    is the `opener` of `Registration`.

    Raises TaskRpcError for an unknown name.
    """
    if (found := TRANSPORTS.get(name)) is not None:
        return found
    from importlib.metadata import entry_points  # it reads the folders of all installed packages

    others = {each.name: each for each in entry_points(group=ENTRY_POINTS)}
    if (point := others.get(name)) is not None:
        return Registration(point.value, package=point.dist.name if point.dist else point.value)
    *most, last = map(repr, [*TRANSPORTS, *sorted(others.keys() - TRANSPORTS.keys())])
    raise TaskRpcError(f"transport: expected {', '.join(most)} or {last}, got {name!r}")


def lab_namespace(name: str, peers: Sequence[str] | None) -> str:
    """Return the default namespace of a node: that of the joined lab if it calls the lab, else "".

    Raises TaskRpcError if the transport is unknown or the lab's file is invalid.
    """
    if not registered(name).in_lab or peers is not None or environment_peers():
        return ""
    lab = remembered_lab()
    return "" if lab is None else lab.namespace


def _open(name: str, registration: Registration, settings: Settings) -> Network:
    if registration.package:
        return _open_added(name, registration, settings)
    module, _, function = registration.opener.partition(":")
    try:
        opener = getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as error:
        if not registration.needs or error.name != registration.needs:
            raise
        problem = f"transport={name!r} needs the module {error.name}, which is not installed"
        raise TaskRpcError(f"{problem}; {registration.advice()}") from None
    return cast("Network", opener(settings))


def _open_added(name: str, registration: Registration, settings: Settings) -> Network:
    """Return the network of another package. Raises TaskRpcError if the package is broken."""
    module, _, function = registration.opener.partition(":")
    try:
        opener = getattr(importlib.import_module(module), function, None)
        if not callable(opener):
            raise TypeError("expected module:function, a function that takes the settings")
        network = opener(settings)
        if missing := missing_names(network, Network):
            raise TypeError(
                f"expected a Network, got {network!r}, which lacks {', '.join(missing)}"
            )
    except TaskRpcError:
        raise  # its text is for the user
    except Exception as error:
        raise TaskRpcError(
            f"transport={name!r}: the package {registration.package} adds it as"
            f" {registration.opener}, which cannot be used: {type(error).__name__}: {error}"
        ) from error
    return cast("Network", network)


def _listed(peers: Sequence[str]) -> Sequence[str]:
    """The peers as a list; users may pass a single peer as a string, which is a sequence too."""
    return [peers] if isinstance(peers, str) else peers
