"""Alignment and padding of values of fixed size: one `struct.Struct` for consecutive values.

Positions count from the first byte of the header, so that slices need no offset. When a codec is
compiled, only the possible remainders of a position modulo 8 are known; these sets are called
`starts` and `ends`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from struct import Struct, calcsize
from typing import Literal

from .errors import CdrError, ended

ORIGIN = 4
"""The position after the header, from which alignment counts."""

ANYWHERE = frozenset(range(8))
"""The possible remainders of an unknown position."""

Role = Literal["header", "length", "nul", "bool", "value", "filler"]
"""The purpose of a value in a fixed part."""

_struct = cache(Struct)


def padding(position: int, alignment: int) -> int:
    """The number of padding bytes before a value of this alignment."""
    return (ORIGIN - position) % alignment


@dataclass(frozen=True, slots=True)
class Item:
    """One value of a fixed part."""

    path: str
    """The path of its field from the message of the codec."""
    what: str
    """Its description in errors: `float64`, `the length of a string`."""
    code: str
    """Its format for `struct`, without padding; `x` for a byte without a value."""
    alignment: int
    role: Role
    variable: str
    """The local variable of generated code that receives it; empty for none."""
    argument: str
    """The expression of generated code that is packed; empty for none."""


class FixedPart:
    """Consecutive values of fixed size, which one `struct` call reads or writes.

    Attributes:
        items: the values.
        layouts: the format, including padding, for each remainder of the start position.
        has_one_layout: whether all possible start positions have the same format.
        layout: the format of one possible start position; only useful if there is only one.
        ends: the possible remainders of the position after the values.
    """

    def __init__(self, items: Sequence[Item], starts: frozenset[int]) -> None:
        self.items = tuple(items)
        self.layouts = tuple(_struct(self._format(start)) for start in range(8))
        used = {self.layouts[start] for start in starts}
        self.has_one_layout = len(used) == 1
        self.ends = frozenset((start + self.layouts[start].size) % 8 for start in starts)
        self.layout = used.pop()

    def _format(self, start: int) -> str:
        parts, at = ["<"], start
        for item in self.items:
            gap = padding(at, item.alignment)
            parts.append("x" * gap + item.code)
            at += gap + calcsize("<" + item.code)
        return "".join(parts)

    @property
    def min_size(self) -> int:
        """The size without padding."""
        return sum(calcsize("<" + item.code) for item in self.items)

    def error(self, data: bytes, at: int) -> CdrError:
        """The error of the first value that the data, read from `at`, do not contain."""
        for item in self.items:
            at += padding(at, item.alignment)
            end = at + calcsize("<" + item.code)
            if end > len(data):
                return ended(item.path, item.what, at, data)
            at = end
        raise AssertionError("all values are within the data")
