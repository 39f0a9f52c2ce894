"""Finds the user of the process at the other end of a connection of this machine (Linux only).

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
from collections.abc import Iterator
from pathlib import Path

_SOCKET_TABLES = ("/proc/net/tcp", "/proc/net/tcp6")
_NO_PROCESS = "0"  # the inode of a socket that its process has closed; its user is shown as root


def is_other_user(peer: tuple[str, int], local: tuple[str, int]) -> bool:
    """Return whether a process of another user of this machine has made a connection.

    Root does not count as another user. Only Linux can tell: elsewhere, and for connections from
    other machines, the result is False. `peer` and `local` are the two ends, as the server sees
    them.
    """
    if sys.platform == "linux" and _is_loopback(peer[0]):
        wanted = _as_in_table(peer), _as_in_table(local)
        users = set()
        try:
            for table in _SOCKET_TABLES:
                users |= set(_users(Path(table), wanted))
        except OSError:
            return False  # a system without these tables
        return not users <= {0, os.getuid()} or not users
    return False


def _users(table: Path, wanted: tuple[tuple[bytes, int], tuple[bytes, int]]) -> Iterator[int]:
    """Yield the users of the sockets with these two ends."""
    if not table.exists():  # a system without IPv6
        return
    ports = f":{wanted[0][1]:04X}", f":{wanted[1][1]:04X}"
    for line in table.read_text().splitlines()[1:]:
        fields = line.split()
        if not (fields[1].endswith(ports[0]) and fields[2].endswith(ports[1])):
            continue
        if fields[9] != _NO_PROCESS and (_end(fields[1]), _end(fields[2])) == wanted:
            yield int(fields[7])


def _end(text: str) -> tuple[bytes, int]:
    """Return address and port from a table of the kernel, which writes 32-bit words."""
    address, _, port = text.partition(":")
    raw = bytes.fromhex(address)
    words = [raw[start : start + 4] for start in range(0, len(raw), 4)]
    if sys.byteorder == "little":
        words = [word[::-1] for word in words]
    return _without_mapping(b"".join(words)), int(port, 16)


def _as_in_table(end: tuple[str, int]) -> tuple[bytes, int]:
    return _without_mapping(ipaddress.ip_address(end[0].partition("%")[0]).packed), end[1]


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
