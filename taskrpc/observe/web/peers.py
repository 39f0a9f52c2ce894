"""Finds which users of this machine have connected, or serve a web page (Linux only).

Linux shows the user of every socket to every process, in `/proc/net/tcp`. Python's standard library
has no call for this on macOS and Windows. The functions of these systems could be called through
ctypes, but do not report the user: Windows names the process of a connection, and hides the user of
processes that belong to others. So a virus scanner that passes the browser's connection on would
look like another user, and would lock the user out. macOS documents no function for it. On these
systems, the token of the link for control protects what the page can change; what the page shows,
and rosbridge, are open to all users of the machine.
"""

from __future__ import annotations

import ipaddress
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

End = tuple[str, int]
"""The address and the port of one end of a connection."""

_SOCKET_TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_NO_PROCESS = "0"  # the inode of a socket that its process has closed; its user is shown as root
_LISTENING = "0A"
_LOCALHOST = [ipaddress.ip_address(each).packed for each in ("127.0.0.1", "::1", "0.0.0.0", "::")]
"""The addresses at which a server is reachable as localhost."""


def is_other_user(peer: End, local: End) -> bool:
    """Return whether a process of another user of this machine has made a connection.

    Root does not count as another user. Only Linux can tell: elsewhere, and for connections from
    other machines, the result is False. `peer` and `local` are the two ends, as the server sees
    them.
    """
    return _is_of_others(peer, lambda table: caller_users(table, peer, local))


def is_page_of_other_user(peer: End, port: int) -> bool:
    """Return whether a browser of this machine shows a page that another user serves at a port.

    Root does not count as another user. If nobody listens at the port, the result is True: another
    user's server can deliver a page, and then end. Only Linux can tell: elsewhere, and for
    browsers of other machines, the result is False. `peer` is the browser's end of the connection.
    """
    return _is_of_others(peer, lambda table: listener_users(table, port))


def _is_of_others(peer: End, users_in: Callable[[str], set[int]]) -> bool:
    """Return whether sockets in the kernel's tables belong to another user, or to nobody."""
    if sys.platform == "linux" and _is_loopback(peer[0]):
        users = set()
        try:
            for table in _SOCKET_TABLES:
                if table.exists():  # a system without IPv6 has only the first one
                    users |= users_in(table.read_text())
        except OSError:
            return False  # a system without these tables
        return not users <= {0, os.getuid()} or not users
    return False


def caller_users(table: str, peer: End, local: End) -> set[int]:
    """Return the users of the callers' sockets, in the text of a table, of a connection."""
    wanted = _as_in_table(peer), _as_in_table(local)
    rows = _rows(table, peer[1], local[1])
    return {int(row[7]) for row in rows if (_address(row[1]), _address(row[2])) == wanted}


def listener_users(table: str, port: int) -> set[int]:
    """Return the users that listen, by the text of a table, at a port of localhost."""
    rows = _rows(table, port, 0)
    return {int(row[7]) for row in rows if row[3] == _LISTENING and _address(row[1]) in _LOCALHOST}


def _rows(table: str, own_port: int, other_port: int) -> Iterator[list[str]]:
    """Yield the fields of the rows with these ports: 1, 2 the ends, 3 the state, 7 the user."""
    own, other = f":{own_port:04X}", f":{other_port:04X}"
    for line in table.splitlines()[1:]:
        fields = line.split()
        if fields[1].endswith(own) and fields[2].endswith(other) and fields[9] != _NO_PROCESS:
            yield fields


def _address(end: str) -> bytes:
    """Return the address of an end in a table of the kernel, which writes 32-bit words."""
    raw = bytes.fromhex(end.partition(":")[0])
    words = [raw[start : start + 4] for start in range(0, len(raw), 4)]
    if sys.byteorder == "little":
        words = [word[::-1] for word in words]
    return _without_mapping(b"".join(words))


def _as_in_table(end: End) -> bytes:
    return _without_mapping(ipaddress.ip_address(end[0].partition("%")[0]).packed)


def _without_mapping(address: bytes) -> bytes:
    """Return an IPv4 address that is written as an IPv6 address as IPv4."""
    mapped = b"\0" * 10 + b"\xff\xff"
    return address[12:] if len(address) == 16 and address.startswith(mapped) else address


def _is_loopback(host: str) -> bool:
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback
