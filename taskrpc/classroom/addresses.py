"""The names and addresses under which other machines may reach this one."""

from __future__ import annotations

import contextlib
import ipaddress
import re
import socket

_HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?").fullmatch

# To choose the address from which something would be sent there; nothing is. One for the way to
# everywhere, one for each range of private networks, which may be reached another way.
_ELSEWHERE = ("192.0.2.1", "192.168.255.254", "10.255.255.254", "172.31.255.254")


def own_addresses() -> list[str]:
    """This machine's IPv4 addresses in its networks, the likeliest first; may be empty."""
    found = [*_outgoing(), *_named()]
    return [each for each in dict.fromkeys(found) if _is_reachable(each)]


def own_names() -> list[str]:
    """What the certificate should call this machine besides those addresses."""
    name = socket.gethostname()
    return [*([name] if is_host(name) else []), "localhost", "127.0.0.1", "::1"]


def is_host(text: str) -> bool:
    """Whether this is a host name, as certificates take them, or an address; without a port."""
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


def _named() -> list[str]:
    try:
        return socket.gethostbyname_ex(socket.gethostname())[2]
    except (OSError, UnicodeError):
        return []


def _is_reachable(address: str) -> bool:
    parsed = ipaddress.ip_address(address)
    return not (parsed.is_loopback or parsed.is_unspecified or parsed.is_link_local)
