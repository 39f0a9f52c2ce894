"""How long a peer may be silent before it is asked, and before it counts as gone."""

from __future__ import annotations

import os
from typing import NamedTuple

from taskrpc.errors import TaskRpcError


class Keepalive(NamedTuple):
    """When a connection looks after a silent peer."""

    silence: float
    """Seconds after which the peer is asked for a sign of life."""
    dead_after: float
    """Seconds without an acknowledgement after which the kernel gives the peer up."""


DEFAULT = Keepalive(silence=5.0, dead_after=8.0)
ROBOT = Keepalive(silence=1.0, dead_after=2.0)
"""For who drives a robot, and must know at once that nobody hears."""

PROFILES = {"default": DEFAULT, "robot": ROBOT}


def keepalive_of(name: str | None) -> Keepalive:
    """The profile of this name, `TASKRPC_KEEPALIVE` where there is none.

    Raises TaskRpcError for a name that is none.
    """
    where = "keepalive" if name else "TASKRPC_KEEPALIVE"
    wanted = name or os.environ.get("TASKRPC_KEEPALIVE") or "default"
    if wanted not in PROFILES:
        expected = " or ".join(PROFILES)
        raise TaskRpcError(f"{where}: expected {expected}, got {wanted!r}")
    return PROFILES[wanted]
