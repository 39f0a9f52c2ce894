"""Spans of time, in nanoseconds."""

from __future__ import annotations

import functools
import math
from typing import Any

import srvgen

from .constants import S_TO_NS


@functools.total_ordering
class Duration:
    """A span of time, which may be negative. Raises OverflowError beyond 63 bits of nanoseconds."""

    def __init__(self, *, seconds: float = 0, nanoseconds: float = 0) -> None:
        given: object = seconds
        if isinstance(given, str | list | tuple):  # the product would fill the memory
            kind = type(given).__name__
            raise TypeError(f"expected seconds as a number, got {kind} {given!r}")
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not -(2**63) <= total < 2**63:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._nanoseconds = total

    @property
    def nanoseconds(self) -> int:
        """The whole span in nanoseconds."""
        return self._nanoseconds

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._nanoseconds})"

    def __str__(self) -> str:
        return "Infinite" if self == Infinite else f"{self._nanoseconds} nanoseconds"

    def __add__(self, other: object) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self._nanoseconds + other._nanoseconds)

    def __sub__(self, other: object) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self._nanoseconds - other._nanoseconds)

    def __mul__(self, factor: object) -> Duration:
        if not isinstance(factor, (int, float)):
            return NotImplemented
        if math.isnan(factor):
            raise ValueError("Can't multiply duration with nan")
        return Infinite if factor == math.inf else Duration(nanoseconds=self._nanoseconds * factor)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Duration):
            return NotImplemented
        return self._nanoseconds == other._nanoseconds

    def __lt__(self, other: object) -> bool:
        if not isinstance(other, Duration):
            return NotImplemented
        return self._nanoseconds < other._nanoseconds

    __hash__ = None  # type: ignore[assignment]

    def to_msg(self) -> Any:
        """The span as a `builtin_interfaces/msg/Duration`."""
        seconds, nanoseconds = divmod(self._nanoseconds, S_TO_NS)
        return _message()(sec=seconds, nanosec=nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any) -> Duration:
        """The span of a `builtin_interfaces/msg/Duration`; raises TypeError for anything else."""
        if not isinstance(msg, _message()):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


@functools.cache
def _message() -> Any:
    return srvgen.load("builtin_interfaces/msg/Duration")


Infinite = Duration(nanoseconds=2**63 - 1)
"""The longest duration, which stands for an infinite one."""
