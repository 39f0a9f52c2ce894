"""What is measured: how many calls at a time, of what size, on one core or wherever."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.harness.contender import Contender

KIB = 1024
MIB = 1024 * KIB
IN_FLIGHT = (1, 8, 64, 512)
PAYLOADS = (KIB, 64 * KIB, MIB, 16 * MIB)


@dataclass(frozen=True)
class Workload:
    """One column of the tables."""

    pinned: bool
    """Both processes on one core; else wherever the system puts them."""
    in_flight: int = 1
    payload: int = 0
    """Bytes that are echoed; with 0 two integers are added."""

    @property
    def key(self) -> str:
        """Its name in the JSON file."""
        where = "pinned" if self.pinned else "free"
        return f"{where}, {self.what}, {self.in_flight} in flight"

    @property
    def what(self) -> str:
        """What is called."""
        return f"echo of {size(self.payload)}" if self.payload else "AddTwoInts"

    def suits(self, contender: Contender) -> bool:
        """Whether the contender can do it."""
        return self.in_flight <= contender.most_in_flight


def phases(*, can_pin: bool) -> list[list[Workload]]:
    """All that is measured here; the rounds of a phase are over before the next one begins.

    A large message leaves its mark on a process: once glibc has freed one, it no longer gives the
    memory of every read back to the system. Asyncio, which reads into 256 KiB of new memory each
    time, is twice as fast from then on. So larger messages come after smaller ones.
    """
    free = [Workload(pinned=False, in_flight=count) for count in IN_FLIGHT]
    pinned = [Workload(pinned=True, in_flight=count) for count in IN_FLIGHT] if can_pin else []
    echoes = [[Workload(pinned=can_pin, payload=payload)] for payload in PAYLOADS]
    return [pinned + free, *echoes]


def size(count: int) -> str:
    """A number of bytes as people write it."""
    return f"{count // MIB} MiB" if count >= MIB else f"{count // KIB} KiB"
