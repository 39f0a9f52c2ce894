"""What runs have reached: calls, faults, and the services that nobody called; pure."""

from __future__ import annotations

import msgspec


class Coverage(msgspec.Struct):
    """What runs have reached."""

    runs: int = 0
    seconds: float = 0.0
    """Virtual seconds."""
    calls: dict[str, int] = {}
    """By service."""
    unanswered: dict[str, int] = {}
    """Calls that ended with an error or never, by service."""
    offered: dict[str, int] = {}
    """In how many runs a service was offered."""
    messages: dict[str, int] = {}
    """Messages that were published, by topic."""
    unheard: dict[str, int] = {}
    """Messages that no subscription got when they were published, by topic."""
    faults: dict[str, int] = {}
    """How often each kind of fault happened."""

    def add(self, other: Coverage) -> None:
        """Add what other runs have reached."""
        self.runs += other.runs
        self.seconds += other.seconds
        for name in "calls", "unanswered", "offered", "messages", "unheard", "faults":
            mine = getattr(self, name)
            for key, count in getattr(other, name).items():
                mine[key] = mine.get(key, 0) + count
