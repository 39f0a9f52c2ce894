"""What every fault harness needs: its size, its seed, and a count of what really happened.

A harness that breaks nothing shows nothing: it requires the faults that it meant to cause. The
same rehearsal, with a bug planted in the product, must find it.
"""

from __future__ import annotations

import collections

TOLD: list[tuple[str, Counts]] = []
"""The counts of every harness of this run, for the summary."""


class Counts(collections.Counter[str]):
    """How often each thing happened; told at the end of the run."""

    def require(self, **least: int) -> None:
        """Fail unless each fault (`_` stands for a space) happened at least so often."""
        wanted = {name.replace("_", " "): count for name, count in least.items()}
        few = {name: self[name] for name, count in wanted.items() if self[name] < count}
        assert not few, f"too few faults to show anything: {few}, wanted {wanted}"

    def broken(self, *promises: str) -> dict[str, int]:
        """Which promises were broken, and how often."""
        return {name: self[name] for name in promises if self[name]}

    def __str__(self) -> str:
        return ", ".join(f"{name} {count}" for name, count in sorted(self.items()))
