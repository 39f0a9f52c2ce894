"""Memory of one thing among many."""

from __future__ import annotations

_LEAST = 1000


def memory_each(total: int, count: int) -> float:
    """Bytes of each; 0.0, unknown, for so few that pages and what was free before decide."""
    return total / count if count >= _LEAST else 0.0
