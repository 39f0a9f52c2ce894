"""The configuration of a Zenoh session: taskrpc's own, and rmw_zenoh's environment variables. Pure.

`ZENOH_SESSION_CONFIG_URI` names a file with a whole configuration. `ZENOH_CONFIG_OVERRIDE` changes
single values: `connect/endpoints=["tcp/robot:7447"];mode="client"`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.spi import is_loopback as is_loopback_host

DEFAULT_PORT = 7447
DEFAULT_ROUTER = f"tcp/localhost:{DEFAULT_PORT}"
FILE_VARIABLE = "ZENOH_SESSION_CONFIG_URI"
OVERRIDE_VARIABLE = "ZENOH_CONFIG_OVERRIDE"
_LOCATOR = re.compile(r"[a-z][a-z0-9_-]*/\S+")
_TEXT = re.compile(r"""["']([^"']+)["']""")
"""A string inside a JSON5 value."""
_HOST = re.compile(r"(\[[\w:.%]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?")
_OWN = {
    "mode": '"client"',
    "scouting/multicast/enabled": "false",
    # The caches of transient_local publishers need time stamps.
    "timestamping/enabled": "true",
    # Programs find a router that comes back within half a second.
    "connect/retry": json.dumps(
        {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
    ),
}


class Configuration(msgspec.Struct, frozen=True):
    """The settings with which a session is opened."""

    file: str
    """The path of a whole configuration, "" for Zenoh's defaults."""
    values: tuple[tuple[str, str], ...]
    """Keys with values as JSON5, in the order in which they are set."""
    routers: tuple[str, ...]
    """The routers to connect to, which errors name; empty if the file names them."""
    routers_from: str = ""
    """The environment variable that names the routers; "" for an argument or the default."""


def configuration_of(
    peers: Sequence[str], *, environ: Mapping[str, str] | None = None
) -> Configuration:
    """Return the configuration of a program; `peers` are addresses of routers.

    Raises TaskRpcError for an invalid address, or an invalid override in the environment.
    """
    environ = environ or {}
    file = environ.get("ZENOH_SESSION_CONFIG_URI", "")
    override = environ.get("ZENOH_CONFIG_OVERRIDE", "")
    file = file.removeprefix("file://")
    routers = tuple(locator(peer) for peer in peers)
    values: list[tuple[str, str]] = []
    if not file:
        routers = routers or (DEFAULT_ROUTER,)
        values += _OWN.items()
    if routers:
        values.append(("connect/endpoints", json.dumps(routers)))
    routers_from = FILE_VARIABLE if file and not routers else ""
    overridden = overrides(override)
    for key, value in overridden:
        if key == "connect/endpoints":
            routers = tuple(filter(_LOCATOR.fullmatch, _TEXT.findall(value))) or (value,)
            routers_from = OVERRIDE_VARIABLE
    return Configuration(file, (*values, *overridden), routers, routers_from)


def start_command(router: str) -> str:
    """Return the command that starts a router at an address as a client writes it."""
    protocol, _, address = router.partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tcp":
        return f"taskrpc router --listen {router}"
    if is_loopback(router):
        is_default = port == str(DEFAULT_PORT)
        host = "127.0.0.1" if host == "localhost" else host
        return "taskrpc router" + ("" if is_default else f" --listen {host}:{port}")
    return f"taskrpc router --listen 0.0.0.0:{port}"


def router_configuration(listen: str) -> Configuration:
    """Return the configuration of a router that listens at an address."""
    values = {
        "mode": '"router"',
        "listen/endpoints": json.dumps([locator(listen)]),
        "scouting/multicast/enabled": "false",
        "scouting/delay": "1",  # milliseconds; the default would delay the start by 0.5 s
        "timestamping/enabled": "true",
    }
    return Configuration("", tuple(values.items()), ())


def overrides(text: str) -> list[tuple[str, str]]:
    """Return the keys and values of `ZENOH_CONFIG_OVERRIDE`. Raises TaskRpcError."""
    found = []
    for part in filter(None, (each.strip() for each in text.split(";"))):
        key, sign, value = part.partition("=")
        if not sign or not key.strip() or not value.strip():
            problem = f"{OVERRIDE_VARIABLE}: expected key=value parts separated by ;, got {part!r}"
            raise TaskRpcError(problem)
        found.append((key.strip(), value.strip()))
    return found


def locator(address: str) -> str:
    """Return an address as Zenoh writes it: `tcp/HOST:PORT`. Raises TaskRpcError."""
    if _LOCATOR.fullmatch(address):
        return address
    found = _HOST.fullmatch(address)
    if found is None:
        raise TaskRpcError(
            f"the address of a Zenoh router: expected HOST:PORT or tcp/HOST:PORT, got {address!r}"
        )
    return f"tcp/{found[1]}:{found[2] or DEFAULT_PORT}"


def is_loopback(address: str) -> bool:
    """Whether only programs of this machine reach the address of a locator."""
    host = address.partition("/")[2].rpartition(":")[0].strip("[]")
    return is_loopback_host(host)
