"""The names and addresses of this machine, at which laptops may reach it."""

from __future__ import annotations

import contextlib
import ipaddress
import re
import socket

_HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?").fullmatch

# A UDP socket that connects to one of these gets the address from which this machine would send; no
# packet is sent. The first stands for the internet, the others for the ranges of private networks,
# which may have another route.
_ELSEWHERE = ("192.0.2.1", "192.168.255.254", "10.255.255.254", "172.31.255.254")


def own_addresses() -> list[str]:
    """Return this machine's IPv4 addresses, the most probable one first; may be empty."""
    found = [*_outgoing(), *_of_host_name()]
    return [each for each in dict.fromkeys(found) if _is_reachable(each)]


def own_names() -> list[str]:
    """Return the names of this machine for the certificate, in addition to `own_addresses`."""
    name = socket.gethostname()
    return [*([name] if is_host(name) else []), "localhost", "127.0.0.1", "::1"]


def is_host(text: str) -> bool:
    """Whether a text is an address, or a host name that certificates can contain; no port."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return bool(_HOST_NAME(text))
    return True


def _outgoing() -> list[str]:
    found = []
    for elsewhere in _ELSEWHERE:
        with (
            contextlib.suppress(OSError),
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe,
        ):
            probe.connect((elsewhere, 9))
            found.append(str(probe.getsockname()[0]))
    return found


def _of_host_name() -> list[str]:
    try:
        return socket.gethostbyname_ex(socket.gethostname())[2]
    except (OSError, UnicodeError):
        return []


def _is_reachable(address: str) -> bool:
    parsed = ipaddress.ip_address(address)
    return not (parsed.is_loopback or parsed.is_unspecified or parsed.is_link_local)
