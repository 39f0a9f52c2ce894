"""The source of random numbers: the operating system, or the seed of an event loop in a test.

Everything random in the library comes from here, so that a run in virtual time can be repeated. A
loop with the attribute `chance` gives it to everything that runs on it. Only
`taskrpc.testing.VirtualTimeLoop` has one. Ids and secrets of real programs always come from the
operating system.
"""

from __future__ import annotations

import asyncio
import os
from typing import Protocol


class Chance(Protocol):
    """Draws random numbers; `random.Random` is one."""

    def random(self) -> float:
        """Return a number from 0 (included) to 1 (excluded)."""

    def randbytes(self, n: int, /) -> bytes:
        """Return `n` bytes."""


class _System:
    """The operating system's generator. Importing `random` would cost every program's start."""

    def random(self) -> float:
        return (int.from_bytes(os.urandom(7)) >> 3) * 2.0**-53

    def randbytes(self, n: int, /) -> bytes:
        return os.urandom(n)


_SYSTEM = _System()


def chance_of(loop: asyncio.AbstractEventLoop) -> Chance:
    """Return the source of an event loop."""
    found: Chance = getattr(loop, "chance", _SYSTEM)
    return found


def present_chance() -> Chance:
    """Return the source of the running event loop; outside of a loop, the operating system's."""
    try:
        return chance_of(asyncio.get_running_loop())
    except RuntimeError:
        return _SYSTEM
