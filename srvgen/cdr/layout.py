"""Where values of fixed size stand in CDR: alignment, padding, one `struct.Struct` for a run.

A position is counted from the first byte of the header, so that slices need no offset; a codec
is compiled with what is known of it then: the set of its possible remainders modulo 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from struct import Struct, calcsize
from typing import Literal

from .errors import CdrError, ended

ORIGIN = 4
"""Alignment is counted from here, behind the header."""

ANYWHERE = frozenset(range(8))
"""The remainders of a position of which nothing is known."""

Role = Literal["header", "length", "nul", "bool", "value", "filler"]
"""What a value of a run is there for."""

_struct = cache(Struct)


def padding(position: int, alignment: int) -> int:
    """How many bytes are skipped before a value of this alignment."""
    return (ORIGIN - position) % alignment


@dataclass(frozen=True, slots=True)
class Item:
    """One value of a run."""

    path: str
    """Its field, seen from the message that the codec is for."""
    what: str
    """What it is, in an error: `float64`, `the length of a string`."""
    code: str
    """Its format for `struct`, without padding; `x` for what has no value."""
    alignment: int
    role: Role
    variable: str
    """The local variable of generated code that receives it; empty for none."""
    argument: str
    """The expression of generated code that is packed; empty for none."""


class Run:
    """Values of fixed size that follow each other, read or written by one call.

    Attributes:
        items: the values.
        layouts: the run's format, padding included, for each remainder of its position.
        is_settled: whether all possible positions have the same format.
        ends: the possible remainders of the position behind the run.
    """

    def __init__(self, items: Sequence[Item], starts: frozenset[int]) -> None:
        self.items = tuple(items)
        self.layouts = tuple(_struct(self._format(start)) for start in range(8))
        used = {self.layouts[start] for start in starts}
        self.is_settled = len(used) == 1
        self.ends = frozenset((start + self.layouts[start].size) % 8 for start in starts)
        self.settled = used.pop()
        """The one format of a settled run."""

    def _format(self, start: int) -> str:
        parts, at = ["<"], start
        for item in self.items:
            gap = padding(at, item.alignment)
            parts.append("x" * gap + item.code)
            at += gap + calcsize("<" + item.code)
        return "".join(parts)

    @property
    def least(self) -> int:
        """The size without any padding."""
        return sum(calcsize("<" + item.code) for item in self.items)

    def fault(self, data: bytes, at: int) -> CdrError:
        """Which value it is that the data, read from `at`, do not have."""
        for item in self.items:
            at += padding(at, item.alignment)
            end = at + calcsize("<" + item.code)
            if end > len(data):
                return ended(item.path, item.what, at, data)
            at = end
        raise AssertionError("the run is within the data")
