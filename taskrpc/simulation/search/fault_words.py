"""The names of faults in words, as stories and recordings show them."""

from __future__ import annotations

from typing import Final

_PAST: Final = {
    "lose": "lost",
    "duplicate": "arriving twice",
    "delay": "overtaken by others",
    "refuse": "refused",
}


def fault_words(name: str) -> str:
    """Return the name of a fault in words: `response 1 of /grasp lost`."""
    first, *words = name.split()
    if first in _PAST and words[0] in ("request", "response"):
        what, number, _, service = words
        return f"{what} {number} of {service} {_PAST[first]}"
    if first == "cut":
        _, _, number, _, caller, _, called = name.split()
        ends = [each.partition("#")[0] for each in (caller, called)]
        return f"connection {number} of {ends[0]} with {ends[1]} broken"
    if first == "kill":
        return f"{words[0]} killed"
    if first == "part":
        return f"{words[0]} and {words[2]} out of each other's reach"
    if first == "slow":
        return f"a slow {words[0]}"
    return f"a wrong clock in {words[1]}" if first == "wrong" else name
