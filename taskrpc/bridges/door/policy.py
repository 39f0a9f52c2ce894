"""The rules of a policy as values: verbs, targets, ranges, rates and hours. Pure.

A target is the absolute name of a service or topic, or a pattern: `/arm/*` is everything below
`/arm`. A rule that permits something reads a pattern narrowly: it leaves out hidden names and the
services that every node of ROS has. All other rules read it widely.
"""

from __future__ import annotations

import math
from typing import TypeAlias, TypeGuard

import msgspec

from taskrpc.spi import names

VERBS = ("call", "read", "publish")
"""`call` a service or an action, `read` a topic or a resource, `publish` to a topic."""

Value: TypeAlias = str | bool | int | float
"""A value that a limit allows."""

DAY, WEEK = 24 * 60, 7 * 24 * 60
"""Minutes."""
_LONGEST = 60
"""Characters that messages show of a text."""


def matches(pattern: str, target: str) -> bool:
    """Return whether a rule for this pattern concerns a target."""
    return pattern == target or (pattern.endswith("/*") and target.startswith(pattern[:-1]))


def overlaps(one: str, other: str) -> bool:
    """Return whether some target is concerned by both patterns."""
    return matches(one, other.removesuffix("*")) or matches(other, one.removesuffix("*"))


def permits(pattern: str, target: str) -> bool:
    """Return whether a rule that permits this pattern permits a target."""
    if pattern == target:
        return True
    is_special = names.is_hidden(target) or names.is_of_every_node(target)
    return matches(pattern, target) and not is_special


class Range(msgspec.Struct, frozen=True):
    """The numbers from `low` to `high`, both included; None for no limit at this end."""

    low: int | float | None
    high: int | float | None

    def allows(self, value: object) -> bool:
        """Return whether a value is a finite number of this range."""
        if not _is_number(value) or (isinstance(value, float) and not math.isfinite(value)):
            return False
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)

    def __str__(self) -> str:
        if self.low is None:
            return f"at most {self.high}"
        if self.high is None:
            return f"at least {self.low}"
        return f"{self.low} to {self.high}" if self.low != self.high else f"{self.low}"


class Values(msgspec.Struct, frozen=True):
    """A list of values; a text is no number, and true is not 1."""

    values: tuple[Value, ...]

    def allows(self, value: object) -> bool:
        """Return whether a value is one of these."""
        return any(_kind(value) is _kind(each) and value == each for each in self.values)

    def __str__(self) -> str:
        *before, last = [shown(each) for each in self.values]
        return f"{', '.join(before)} or {last}" if before else last


class Rule(msgspec.Struct, frozen=True):
    """A verb and a target, such as `call /robot_task`."""

    verb: str
    target: str
    line: int
    timeout: float = 0.0
    """Seconds that a person has for the approval; 0.0 if none is needed."""

    def concerns(self, verb: str, target: str) -> bool:
        """Return whether the rule is about this request."""
        return verb == self.verb and matches(self.target, target)

    def includes(self, other: Rule) -> bool:
        """Return whether the rule concerns all that another rule concerns."""
        return self.concerns(other.verb, other.target)

    def permits(self, verb: str, target: str) -> bool:
        """Return whether the rule is enough to permit this request."""
        return verb == self.verb and permits(self.target, target)

    def __str__(self) -> str:
        return f"{self.verb} {self.target}"


class Limit(msgspec.Struct, frozen=True):
    """What one field may be, such as `linear.x`; an array's limit holds for each element."""

    path: tuple[str, ...]
    line: int
    values: Range | Values | None = None
    length: Range | None = None
    """The number of elements of an array, or of characters of a text."""

    @property
    def field(self) -> str:
        """The path as in the file: `linear.x`."""
        return ".".join(self.path)


class Limits(msgspec.Struct, frozen=True):
    """The limits on the requests to a service, or on the messages to a topic."""

    target: str
    limits: tuple[Limit, ...]
    line: int


class Rate(msgspec.Struct, frozen=True):
    """The most requests to a target, together: `count` in any `period` seconds."""

    target: str
    count: int
    period: float
    text: str
    """The rate as in the file: `6/min`."""
    line: int


class Window(msgspec.Struct, frozen=True):
    """Times of a week. Minutes count from midnight; a window may end on the next day."""

    days: tuple[int, ...]
    """The days on which the window begins; Monday is 0."""
    begin: int
    end: int
    text: str
    """The window as in the file: `mon-fri 08:00..18:00`."""

    def has(self, minute: int) -> bool:
        """Return whether a minute of the week, counted from Monday 0:00, is in the window."""
        length = self.end - self.begin if self.end > self.begin else self.end + DAY - self.begin
        return any((minute - day * DAY - self.begin) % WEEK < length for day in self.days)


class Hours(msgspec.Struct, frozen=True):
    """The times at which requests to a target are allowed."""

    target: str
    windows: tuple[Window, ...]
    line: int

    def __str__(self) -> str:
        return " and ".join(each.text for each in self.windows)


class Rules(msgspec.Struct, frozen=True):
    """All rules of one name."""

    line: int
    may: tuple[Rule, ...] = ()
    never: tuple[Rule, ...] = ()
    ask: tuple[Rule, ...] = ()
    dry_run: tuple[Rule, ...] = ()
    limits: tuple[Limits, ...] = ()
    rate: tuple[Rate, ...] = ()
    when: tuple[Hours, ...] = ()


class Policy(msgspec.Struct, frozen=True):
    """The rules of each name."""

    names: dict[str, Rules]


def _is_number(value: object) -> TypeGuard[int | float]:
    """Return whether a value is an integer or a float; true and false are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def shown(value: object) -> str:
    """Return a value for a message: short, and in ASCII, so that similar letters look different."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):  # Python may refuse to print a long one
        return f"{value}" if value.bit_length() <= 256 else "a far larger number"
    if isinstance(value, float):
        return f"{value}"
    if isinstance(value, str):
        return ascii(value if len(value) <= _LONGEST else f"{value[:_LONGEST]}...")
    return f"a value of type {type(value).__name__}"


def _kind(value: object) -> type:
    """Return the class of values to which a value can be equal."""
    if isinstance(value, bool):
        return bool
    if isinstance(value, str):
        return str
    return float if _is_number(value) else type(value)
