"""Reads a policy from YAML; a mistake is shown with its line and a caret. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from typing import TypeVar

import msgspec

from srvgen.definitions.names import did_you_mean
from taskrpc.bridges.door.policy import (
    DAY,
    VERBS,
    Hours,
    Limit,
    Limits,
    Policy,
    Range,
    Rate,
    Rule,
    Rules,
    Value,
    Values,
    Window,
)
from taskrpc.errors import InvalidName
from taskrpc.spi import account_name_problem, names
from taskrpc.spi import yaml_document as documents

T = TypeVar("T")

APPROVAL_TIMEOUT = 60.0
"""Seconds that a person has for an approval, if the policy names no other time."""

MOST_REQUESTS = 1000
"""The largest count of a rate: the door keeps the times of so many requests."""

_LONGEST_NUMBER = 400
"""Python refuses to read an integer of some thousand digits."""
_DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "day": 86400.0}
_NUMBER = r"[-+]?[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?"
_RANGE = re.compile(rf"({_NUMBER})?\.\.({_NUMBER})?")
_RATE = re.compile(r"([1-9][0-9]{0,3}) ?/ ?(s|min|h|day)")
_DURATION = re.compile(rf"({_NUMBER}) ?(s|min|h)")
_TIME = "([01][0-9]|2[0-4]):([0-5][0-9])"
_WINDOW = re.compile(rf"(?:({'|'.join(_DAYS)})(?:-({'|'.join(_DAYS)}))? +)?{_TIME}\.\.{_TIME}")
_FIELD = re.compile(r"[A-Za-z][A-Za-z0-9_]*(?:\.[A-Za-z][A-Za-z0-9_]*)*")


class PolicyError(documents.DocumentError):
    """A policy file cannot be read, or it has a mistake."""


class Known(msgspec.Struct, frozen=True):
    """The names that the running programs have."""

    services: Collection[str]
    topics: Collection[str]

    def of(self, verb: str) -> Collection[str]:
        """Return the names for a verb; for all verbs if it is ""."""
        if verb == "call":
            return self.services
        return self.topics if verb else {*self.services, *self.topics}


def parse_policy(text: str, path: str = "policy", known: Known | None = None) -> Policy:
    """Read a policy from its text; error messages name it `path`.

    With `known`, names that no program has are mistakes, too. Raises PolicyError.
    """
    document = documents.Document(text, path, what="the policy", error=PolicyError)
    return _Reader(document, known).policy()


class _Reader:
    def __init__(self, document: documents.Document, known: Known | None) -> None:
        self._document = document
        self._fail = document.fail
        self._known = known

    def policy(self) -> Policy:
        entries = self._document.entries(self._document.root, "a policy")
        return Policy({self._name(key): self._rules(key, value) for key, value in entries})

    def _name(self, node: documents.Node) -> str:
        if problem := account_name_problem(node.value):
            self._fail(node, problem)
        return str(node.value)

    def _rules(self, key: documents.Node, value: documents.Node) -> Rules:
        found = self._document.fields(value, key.value, (), Rules.__struct_fields__[1:])
        return Rules(
            _line(key),
            may=self._list(found.get("may"), "may"),
            never=self._list(found.get("never"), "never"),
            ask=self._ask(found.get("ask")),
            dry_run=self._list(found.get("dry_run"), "dry_run"),
            limits=self._by_target(found.get("limits"), "limits", self._limits),
            rate=self._by_target(found.get("rate"), "rate", self._rate),
            when=self._by_target(found.get("when"), "when", self._hours),
        )

    # Rules with a verb

    def _list(self, node: documents.Node | None, what: str) -> tuple[Rule, ...]:
        return tuple(self._rule(each, what) for each in self._document.items(node, what))

    def _ask(self, node: documents.Node | None) -> tuple[Rule, ...]:
        if node is None or node.id != "mapping":
            timeouts = [(each, APPROVAL_TIMEOUT) for each in self._document.items(node, "ask")]
        else:
            entries = self._document.entries(node, "ask")
            timeouts = [(key, self._duration(value)) for key, value in entries]
        return tuple(self._rule(each, "ask", timeout) for each, timeout in timeouts)

    def _rule(self, node: documents.Node, what: str, timeout: float = 0.0) -> Rule:
        such = "such as `call /robot_task`"
        if node.id != "scalar":
            self._fail(node, f"{what}: expected a verb and a name {such}, got {_got(node)}")
        verb, space, rest = node.value.partition(" ")
        target = rest.lstrip()
        if verb.startswith("/") or not space:
            self._fail(node, f"{what}: expected a verb and a name {such}, got {_got(node)}")
        if verb not in VERBS:
            expected = f"expected call, read or publish before the name, got {verb!r}"
            self._fail(node, f"{what}: {_with_hint(expected, verb, VERBS)}")
        offset = len(node.value) - len(target)
        return Rule(verb, self._target(node, target, offset, verb), _line(node), timeout)

    def _target(self, node: documents.Node, text: str, offset: int, verb: str) -> str:
        """Check an absolute name or a pattern, which begins at `offset` in the node."""
        if not text.startswith("/"):
            near = f"write /{text}" if text else "such as /robot_task"
            expected = "expected an absolute name, because a policy belongs to no node"
            self._fail(node, f"{expected}: {near}", offset)
        is_pattern = text.endswith("/*")
        name = text.removesuffix("/*")
        if "*" in name:
            expected = "expected * only as the last part of a name, such as /robot_task/*"
            self._fail(node, f"{expected}; got {text!r}", offset + text.index("*"))
        try:
            if name or not is_pattern:
                names.check_absolute(name, "name")
        except InvalidName as error:
            self._fail(node, f"{text!r}: {error.problem}", offset + error.index)
        if self._known is not None:
            self._check_known(node, text, offset, self._known.of(verb))
        return text

    def _check_known(
        self, node: documents.Node, text: str, offset: int, known: Collection[str]
    ) -> None:
        is_known = text in known or f"{text}/_action/send_goal" in known
        if text.endswith("/*"):
            is_known = any(each.startswith(text[:-1]) for each in known)
        if not is_known:
            problem = f"no running program has {text}"
            self._fail(node, _with_hint(problem, text, known), offset)

    def _by_target(
        self,
        node: documents.Node | None,
        what: str,
        read: Callable[[str, documents.Node, int], T],
    ) -> tuple[T, ...]:
        entries = [] if node is None else self._document.entries(node, what)
        return tuple(
            read(self._target(key, key.value, 0, ""), value, _line(key)) for key, value in entries
        )

    # Limits

    def _limits(self, target: str, node: documents.Node, line: int) -> Limits:
        entries = self._document.entries(node, f"the limits of {target}")
        return Limits(target, tuple(self._limit(key, value) for key, value in entries), line)

    def _limit(self, key: documents.Node, value: documents.Node) -> Limit:
        if "[" in key.value:
            problem = "write poses.x without brackets: a limit holds for each element of an array"
            self._fail(key, problem, key.value.index("["))
        if not _FIELD.fullmatch(key.value):
            expected = "expected a field such as priority or linear.x"
            self._fail(key, f"{expected}, got {key.value!r}")
        path = tuple(key.value.split("."))
        if value.id != "mapping":
            return Limit(path, _line(key), self._values(value))
        found = self._document.fields(value, key.value, (), ("length", "each"))
        if not found:
            self._fail(value, f"{key.value}: expected length, each or both")
        values = self._values(found["each"]) if "each" in found else None
        length = self._length(found["length"]) if "length" in found else None
        return Limit(path, _line(key), values, length)

    def _length(self, node: documents.Node) -> Range:
        found = self._values(node)
        if isinstance(found, Values):
            value = found.values[0]
            if len(found.values) > 1 or type(value) is not int:
                self._fail(node, f"expected a length such as 0..5, got {_got(node)}")
            return Range(value, value)
        return found

    def _values(self, node: documents.Node) -> Range | Values:
        if node.id == "sequence":
            if not node.value:
                self._fail(node, "expected at least one value; the list is empty")
            return Values(tuple(self._value(each) for each in node.value))
        if node.id == "scalar" and node.style is None and ".." in node.value:
            return self._range(node)
        return Values((self._value(node),))

    def _range(self, node: documents.Node) -> Range:
        found = _RANGE.fullmatch(node.value)
        if found is None or not any(found.groups()):
            expected = "expected a range such as 1..5, 1.. or ..5 (or a text in quotes)"
            self._fail(node, f"{expected}, got {_got(node)}")
        low, high = (None if each is None else self._number(node, each) for each in found.groups())
        if low is not None and high is not None and low > high:
            self._fail(node, f"no number lies in the range {node.value}: write {high}..{low}")
        return Range(low, high)

    def _value(self, node: documents.Node) -> Value:
        if node.id != "scalar":
            self._fail(node, f"expected a value, got {_got(node)}")
        text = str(node.value)
        if node.style is not None:
            return text
        if re.fullmatch(_NUMBER, text):
            return self._number(node, text)
        if text in ("true", "false"):
            return text == "true"
        if ".." in text:
            self._fail(node, f"a range stands alone, without a list; got {text!r}")
        if not node.tag.endswith(":str"):
            expected = "expected a number such as 5 or 0.2, true, false, or a text in quotes"
            self._fail(node, f"{expected}; got {_got(node)}")
        return text

    def _number(self, node: documents.Node, text: str) -> int | float:
        value = float(text) if len(text) <= _LONGEST_NUMBER else math.inf
        if not math.isfinite(value):
            self._fail(node, f"expected a number that a float64 can hold, got {text[:40]}")
        return int(text) if re.fullmatch("[-+]?[0-9]+", text) else value

    # Rates and times

    def _rate(self, target: str, node: documents.Node, line: int) -> Rate:
        found = self._match(_RATE, node, "a rate such as 6/min (s, min, h or day)")
        count = int(found[1])
        if count > MOST_REQUESTS:
            self._fail(node, f"expected at most {MOST_REQUESTS} requests, got {count}")
        return Rate(target, count, _UNITS[found[2]], f"{count}/{found[2]}", line)

    def _duration(self, node: documents.Node) -> float:
        expected = "a time for the approval such as 30s (s, min or h)"
        found = self._match(_DURATION, node, expected)
        seconds = float(found[1]) * _UNITS[found[2]]
        if not 0.0 < seconds <= _UNITS["day"]:
            self._fail(node, f"expected {expected}, at most 24h; got {_got(node)}")
        return seconds

    def _hours(self, target: str, node: documents.Node, line: int) -> Hours:
        listed = self._document.items(node, "when") if node.id == "sequence" else [node]
        if not listed:
            self._fail(node, "expected times such as mon-fri 08:00..18:00; the list is empty")
        return Hours(target, tuple(self._window(each) for each in listed), line)

    def _window(self, node: documents.Node) -> Window:
        expected = "times such as mon-fri 08:00..18:00, sat 10:00..12:00 or 22:00..06:00"
        first, last, *clock = self._match(_WINDOW, node, expected).groups()
        begin, end = (int(clock[at]) * 60 + int(clock[at + 1]) for at in (0, 2))
        if begin >= DAY or end > DAY or begin == end:
            self._fail(node, f"expected {expected}; got {_got(node)}")
        days = range(7)
        if first is not None:
            start, stop = _DAYS.index(first), _DAYS.index(last or first)
            days = range(start, stop + 1 if stop >= start else stop + 8)
        return Window(tuple(day % 7 for day in days), begin, end, node.value)

    def _match(
        self, pattern: re.Pattern[str], node: documents.Node, expected: str
    ) -> re.Match[str]:
        found = pattern.fullmatch(node.value) if node.id == "scalar" else None
        if found is None:
            self._fail(node, f"expected {expected}; got {_got(node)}")
        return found


def _with_hint(problem: str, word: str, known: Collection[str]) -> str:
    hint = did_you_mean(word, known)
    return f"{problem}; {hint}" if hint else problem


def _got(node: documents.Node) -> str:
    return documents.describe(node)


def _line(node: documents.Node) -> int:
    return node.start_mark.line + 1
