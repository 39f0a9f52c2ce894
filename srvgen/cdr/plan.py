"""The order of a message's values in CDR, from which the encoder and the decoder are compiled.

A plan has two views of a class: `root` is the tree of nested messages, which the encoder reads and
the decoder builds; `steps` is the order on the wire. A step is a `FixedPart` (values of fixed size)
or a `VariablePart`, whose count is in the fixed part before it. The values of a single nested
message become steps of the outer message; only sequences of messages stay whole.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

from msgspec import StructMeta

from .layout import ANYWHERE, FixedPart, Item, Role, padding

ValueKind = Literal["number", "bool", "byte", "string", "wstring", "message"]

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
_OTHERS: dict[str, tuple[ValueKind, str]] = {
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
    """One field that is not a single message, and its names in generated code."""

    number: int
    """Makes the names of its local variables unique."""
    source: str
    """The expression of generated code that reads the field, `m1.ranges`."""
    path: str
    """The path from the message of the plan: `header.frame_id`."""
    declared: str
    """The type as in the definition: `float32[<=3]`."""
    kind: ValueKind
    """The kind of one element."""
    code: str
    """The format of one element for `struct`; empty if its size depends on its content."""
    bound: int | None
    """N of `string<=N`."""
    is_array: bool
    fixed: int | None
    """N of `[N]`."""
    most: int | None
    """N of `[<=N]`."""
    cls: Any
    """The class of the elements if they are messages, or of the numeric array itself."""

    @property
    def size(self) -> int:
        """The size of one element of fixed size, which is also its alignment."""
        return _SIZES[self.code.lower()]

    @property
    def has_fixed_size(self) -> bool:
        """Whether the size does not depend on the content."""
        return bool(self.code) and (not self.is_array or self.fixed is not None)

    @property
    def content(self) -> str:
        """The local variable of generated code with the content as on the wire."""
        return f"v{self.number}"

    @property
    def count(self) -> str:
        """The local variable with the length, or the length itself if it is fixed."""
        return f"n{self.number}" if self.fixed is None else str(self.fixed)


@dataclass(frozen=True, slots=True)
class VariablePart:
    """A value whose size depends on its content."""

    value: Value
    is_aligned: bool
    """Whether its first element never needs padding."""


@dataclass(frozen=True, slots=True)
class Node:
    """The outermost or a nested message, with its fields by attribute."""

    cls: Any
    number: int
    variable: str
    """The local variable of generated code with the message."""
    source: str
    """The expression that reads it."""
    fields: dict[str, Value | Node] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Plan:
    """The values of a class in order."""

    root: Node
    steps: tuple[FixedPart | VariablePart, ...]
    ends: frozenset[int]
    """The possible remainders of the position after the message."""
    min_size: int
    """The minimum bytes of a message; counts are checked against it before memory is allocated."""


KEPT_CLASSES = 1024
"""Maximum number of classes whose plans and functions are kept in memory."""


@lru_cache(KEPT_CLASSES)
def plan_of(cls: Any, is_element: bool) -> Plan:
    """The plan of a whole message with its header, or of an element of a sequence."""
    return _Planner(is_element).plan(cls)


class _Planner:
    """Visits the fields in order and keeps track of the possible positions."""

    def __init__(self, is_element: bool) -> None:
        self.steps: list[FixedPart | VariablePart] = []
        self.starts = ANYWHERE if is_element else frozenset({0})
        self.min_size = 0
        self._items: list[Item] = []  # values of the fixed part that is not finished yet
        self._numbers = 0  # the last number that made a local variable unique
        if not is_element:
            self._items.append(Item("", "a header of 4 bytes", "H2x", 1, "header", "kind", "0x100"))

    def plan(self, cls: Any) -> Plan:
        root = self._message(cls, "message", "message", "")
        self._end_fixed_part()
        return Plan(root, tuple(self.steps), self.starts, self.min_size)

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers

    def _message(self, cls: Any, variable: str, source: str, path: str) -> Node:
        node = Node(cls, self._number(), variable, source)
        if not cls._FIELDS:
            what = "the byte of an empty message"
            self._items.append(Item(path, what, "x", 1, "filler", "", ""))
        blank = StructMeta.__call__(cls)  # a subclass in a program may have its own `__init__`
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
        if value.has_fixed_size:
            self._items.append(_fixed_item(value))
            return
        if value.fixed is None:
            what = f"the length of a {value.declared}"
            self._items.append(Item(value.path, what, "I", 4, "length", value.count, value.count))
        self._end_fixed_part()
        aligned = value.code == "" or not any(padding(at, value.size) for at in self.starts)
        self.steps.append(VariablePart(value, aligned))
        self.starts = _offsets_after(value, self.starts)
        self.min_size += _min_size(value)
        if value.kind == "string" and not value.is_array:
            what = "the NUL of a string"
            self._items.append(Item(value.path, what, "B", 1, "nul", f"z{value.number}", "0"))

    def _end_fixed_part(self) -> None:
        if self._items:
            part = FixedPart(self._items, self.starts)
            self.steps.append(part)
            self.starts = part.ends
            self.min_size += part.min_size
            self._items = []


def _stored(cls: Any, name: str, attribute: str) -> str:
    """The attribute with the stored value of a field; the public one may return numpy arrays."""
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


def _fixed_item(value: Value) -> Item:
    role: Role = "bool" if value.kind == "bool" and not value.is_array else "value"
    code, argument = value.code, value.source
    if value.fixed is not None:
        code, argument = f"{value.fixed * value.size}s", value.content
    return Item(value.path, value.declared, code, value.size, role, value.content, argument)


def _offsets_after(value: Value, starts: frozenset[int]) -> frozenset[int]:
    """The possible remainders of the position after a variable part, from those before it."""
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


def _min_size(value: Value) -> int:
    if value.is_array:
        if value.fixed is None:
            return 0
        return value.fixed * (
            plan_of(value.cls, is_element=True).min_size if value.kind == "message" else 4
        )
    # The next fixed part counts the NUL of a string, but a string of length 0 has none.
    return -1 if value.kind == "string" else 0
