"""What differs between the students of a lab, derived from the ID of a variant."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TypeVar

_Option = TypeVar("_Option")


class Variant:
    """The choices that belong to an ID; the same ID always gives the same choices.

    Each choice has a name of its own, so adding one changes no other. The ID "" is the lab as on
    the sheet: every choice is then the first option, and every number the lowest.

    Args:
        id: anything that names a student or a group, such as `ada` or `group 7`.
    """

    def __init__(self, id: str = "") -> None:
        self.id = id

    def choose(self, name: str, options: Sequence[_Option]) -> _Option:
        """Return one of the options."""
        return options[self._derived(name) % len(options)]

    def number(self, name: str, lowest: int, highest: int) -> int:
        """Return an integer from `lowest` to `highest`, both included."""
        return lowest + self._derived(name) % (highest - lowest + 1)

    def order(self, name: str, options: Sequence[_Option]) -> list[_Option]:
        """Return all the options in an order of their own."""
        if not self.id:
            return list(options)
        order = sorted(range(len(options)), key=lambda index: self._derived(f"{name}/{index}"))
        return [options[index] for index in order]

    def _derived(self, name: str) -> int:
        if not self.id:
            return 0
        return int.from_bytes(hashlib.sha256(f"{self.id}\n{name}".encode()).digest()[:8], "big")
