"""Checks whether the programs of this machine can connect to each other at 127.0.0.1."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys

from taskrpc.cli.ros.doctor.checks import Finding, problem

TIMEOUT = 2.0
"""Seconds for a connection of this machine with itself."""

_GET_FLAGS = 0x8913  # SIOCGIFFLAGS of <linux/sockios.h>
_IS_UP = 0x1  # IFF_UP of <net/if.h>


def loopback() -> Finding | None:
    """Return why this machine cannot connect to itself, and what to do; None if it can."""
    reason = _failure()
    if not reason:
        return None
    if _is_down():
        return problem(
            "the loopback interface lo is down: programs of this machine cannot reach each other"
            " at 127.0.0.1",
            "bring it up: sudo ip link set lo up",
        )
    advice = "a firewall of this machine may block them: allow connections to 127.0.0.1"
    if sys.platform == "darwin":
        advice = f"if the interface is down, bring it up: sudo ifconfig lo0 up; or {advice}"
    return problem(f"connections of this machine to 127.0.0.1 fail: {reason}", advice)


def _failure() -> str:
    """Connect to a socket of this process; returns why this fails, "" if it does not."""
    try:
        with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as client:
            client.settimeout(TIMEOUT)
            client.connect(server.getsockname())
    except TimeoutError:
        return f"no response within {TIMEOUT:g} s"
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _is_down() -> bool:
    """Return whether the interface lo is down; False on systems other than Linux."""
    if sys.platform == "linux":
        import fcntl  # Windows has none

        asked = struct.pack("16sh14x", b"lo", 0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock, contextlib.suppress(OSError):
            flags: int = struct.unpack("16sh14x", fcntl.ioctl(sock, _GET_FLAGS, asked))[1]
            return not flags & _IS_UP
    return False
