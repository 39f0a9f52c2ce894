"""A message class → the order in which its values stand in CDR, for the encoder and the decoder.

A plan has two views of the same class: `root`, the tree of nested messages, which the encoder
reads and the decoder builds; and `steps`, what stands behind what. A step is a `Run` of values of
fixed size, or a `Tail`, whose size only its content tells, with its count in the run before it.
Single nested messages are dissolved into the steps; only sequences of messages stay whole.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

from .layout import ANYWHERE, Item, Role, Run, padding

Kind = Literal["number", "bool", "byte", "string", "wstring", "message"]

_NUMBERS = {
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_OTHERS: dict[str, tuple[Kind, str]] = {
    "bool": ("bool", "B"),
    "byte": ("byte", "c"),
    "string": ("string", ""),
    "wstring": ("wstring", ""),
}
_SIZES = {"b": 1, "c": 1, "h": 2, "i": 4, "q": 8, "f": 4, "d": 8}
_TYPE = re.compile(
    r"(?P<base>[\w/]+)(<=(?P<bound>\d+))?(?P<array>\[(?P<upper><=)?(?P<size>\d+)?\])?"
)


@dataclass(frozen=True, slots=True)
class Value:
    """One field that is not a single message, as generated code names and types it."""

    number: int
    """By which its local variables are told from others."""
    source: str
    """The expression of generated code that reads the field, `m1.ranges`."""
    path: str
    """Seen from the message that the plan is for: `header.frame_id`."""
    declared: str
    """As the definition spells it: `float32[<=3]`."""
    kind: Kind
    """Of one element."""
    code: str
    """The format of one element for `struct`; empty where its size depends on its content."""
    bound: int | None
    """N of `string<=N`."""
    is_array: bool
    fixed: int | None
    """N of `[N]`."""
    most: int | None
    """N of `[<=N]`."""
    cls: Any
    """The class of the elements, where they are messages, or of a numeric array itself."""

    @property
    def size(self) -> int:
        """The size of one element of fixed size, which is also its alignment."""
        return _SIZES[self.code.lower()]

    @property
    def is_settled(self) -> bool:
        """Whether its size does not depend on its content."""
        return bool(self.code) and (not self.is_array or self.fixed is not None)

    @property
    def content(self) -> str:
        """The local variable of generated code that holds what is on the wire."""
        return f"v{self.number}"

    @property
    def count(self) -> str:
        """The local variable that holds its length, or the length itself where it is fixed."""
        return f"n{self.number}" if self.fixed is None else str(self.fixed)


@dataclass(frozen=True, slots=True)
class Tail:
    """A value whose size only its content tells, and what is known of its place."""

    value: Value
    is_aligned: bool
    """Whether its first element needs no padding, wherever it stands."""


@dataclass(frozen=True, slots=True)
class Node:
    """A message, the outermost or a nested one, with its fields by attribute."""

    cls: Any
    number: int
    variable: str
    """The local variable of generated code that holds it."""
    source: str
    """The expression that reads it."""
    fields: dict[str, Value | Node] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Plan:
    """The order of a class's values."""

    root: Node
    steps: tuple[Run | Tail, ...]
    ends: frozenset[int]
    """The possible remainders of the position behind the message."""
    least: int
    """No message is shorter: what a count is checked against before anything is made."""


KEPT_CLASSES = 1024
"""Message classes whose plans and code are kept; a program may make any number as it runs."""


@lru_cache(KEPT_CLASSES)
def plan_of(cls: Any, is_element: bool) -> Plan:
    """The plan of a whole message with its header, or of an element of a sequence."""
    return _Planner(is_element).plan(cls)


class _Planner:
    """Walks the fields in order and keeps what is known of the position."""

    def __init__(self, is_element: bool) -> None:
        self.steps: list[Run | Tail] = []
        self.starts = ANYWHERE if is_element else frozenset({0})
        self.least = 0
        self._items: list[Item] = []
        self._numbers = 0
        if not is_element:
            self._items.append(Item("", "a header of 4 bytes", "H2x", 1, "header", "kind", "0x100"))

    def plan(self, cls: Any) -> Plan:
        root = self._message(cls, "message", "message", "")
        self._end_run()
        return Plan(root, tuple(self.steps), self.starts, self.least)

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers

    def _message(self, cls: Any, variable: str, source: str, path: str) -> Node:
        node = Node(cls, self._number(), variable, source)
        if not cls._FIELDS:
            what = "the byte of an empty message"
            self._items.append(Item(path, what, "x", 1, "filler", "", ""))
        blank = cls()
        for (name, type_), attribute in zip(cls._FIELDS, cls.__struct_fields__, strict=True):
            inner = f"{path}.{name}" if path else name
            stored = _stored(cls, name, attribute)
            read = f"{variable}.{stored}"
            nested = cls._NESTED.get(name)
            if nested is not None and "[" not in type_:
                node.fields[attribute] = self._message(nested, f"m{self._number()}", read, inner)
            else:
                made = nested or type(getattr(blank, stored))
                value = _value(self._number(), read, inner, type_, made)
                node.fields[attribute] = value
                self._add(value)
        return node

    def _add(self, value: Value) -> None:
        if value.is_settled:
            self._items.append(_settled_item(value))
            return
        if value.fixed is None:
            what = f"the length of a {value.declared}"
            self._items.append(Item(value.path, what, "I", 4, "length", value.count, value.count))
        self._end_run()
        aligned = value.code == "" or not any(padding(at, value.size) for at in self.starts)
        self.steps.append(Tail(value, aligned))
        self.starts = _behind(value, self.starts)
        self.least += _least(value)
        if value.kind == "string" and not value.is_array:
            what = "the NUL of a string"
            self._items.append(Item(value.path, what, "B", 1, "nul", f"z{value.number}", "0"))

    def _end_run(self) -> None:
        if self._items:
            run = Run(self._items, self.starts)
            self.steps.append(run)
            self.starts = run.ends
            self.least += run.least
            self._items = []


def _stored(cls: Any, name: str, attribute: str) -> str:
    """The attribute that reads a field as it is stored; the other one may show numpy's arrays."""
    return f"_{name}" if isinstance(getattr(cls, f"_{name}", None), property) else attribute


def _value(number: int, source: str, path: str, type_: str, made: Any) -> Value:
    parts = _TYPE.fullmatch(type_)
    assert parts is not None
    kind, code = _OTHERS.get(parts["base"], ("number", _NUMBERS.get(parts["base"], "")))
    size = _whole(parts["size"])
    return Value(
        number,
        source,
        path,
        type_,
        kind if "/" not in parts["base"] else "message",
        code,
        _whole(parts["bound"]),
        parts["array"] is not None,
        None if parts["upper"] else size,
        size if parts["upper"] else None,
        made,
    )


def _whole(text: str | None) -> int | None:
    return None if text is None else int(text)


def _settled_item(value: Value) -> Item:
    role: Role = "bool" if value.kind == "bool" and not value.is_array else "value"
    code, argument = value.code, value.source
    if value.fixed is not None:
        code, argument = f"{value.fixed * value.size}s", value.content
    return Item(value.path, value.declared, code, value.size, role, value.content, argument)


def _behind(value: Value, starts: frozenset[int]) -> frozenset[int]:
    """The possible remainders of the position behind a tail, from those before it."""
    match value.kind:
        case "string":
            return ANYWHERE
        case "wstring":
            return frozenset({0, 4})
        case "message":
            return starts | plan_of(value.cls, is_element=True).ends
        case _:
            first = {start + padding(start, value.size) for start in starts}
            return starts | {(at + n * value.size) % 8 for at in first for n in range(8)}


def _least(value: Value) -> int:
    if value.is_array:
        if value.fixed is None:
            return 0
        return value.fixed * (
            plan_of(value.cls, is_element=True).least if value.kind == "message" else 4
        )
    # A string of length 0 has no NUL behind its length, which the run behind it has counted.
    return -1 if value.kind == "string" else 0
