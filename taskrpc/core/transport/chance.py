"""The source of random numbers: the operating system, or the seed of an event loop in a test.

Everything random in the library comes from here, so that a run in virtual time can be repeated. A
loop with the attribute `chance` gives it to everything that runs on it. Only
`taskrpc.testing.VirtualTimeLoop` has one. Ids and secrets of real programs always come from the
operating system. A thread of a store draws from the source that it was given.
"""

from __future__ import annotations

import asyncio
import os
import threading
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
_given = threading.local()


def chance_of(loop: asyncio.AbstractEventLoop) -> Chance:
    """Return the source of an event loop."""
    found: Chance = getattr(loop, "chance", _SYSTEM)
    return found


def is_seeded(loop: asyncio.AbstractEventLoop) -> bool:
    """Return whether an event loop has a source of its own, so that its run can be repeated."""
    return hasattr(loop, "chance")


def give_chance(chance: Chance) -> None:
    """Let this thread, which runs no event loop, draw from a source."""
    _given.chance = chance


def present_chance() -> Chance:
    """Return the source of the running event loop, else of this thread, else the system's."""
    try:
        return chance_of(asyncio.get_running_loop())
    except RuntimeError:
        found: Chance = getattr(_given, "chance", _SYSTEM)
        return found
