"""The parsed form of interface definitions: frozen values without behaviour."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, TypeAlias

from msgspec import Struct

Kind = Literal["msg", "srv", "action"]

Scalar: TypeAlias = bool | int | float | str
"""One literal of a definition. `byte` and `char` are integers 0..255 here."""

Value: TypeAlias = Scalar | tuple[Scalar, ...]
"""A default: one literal, or one per element of an array."""

PRIMITIVES = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 "
    "string wstring".split()
)
"""The names of ROS 2's built-in types."""


class FieldType(Struct, frozen=True):
    """The type of a field: a base type, optionally bounded, or an array of it."""

    base: str
    """`int32`, `string`, or a message's bare name such as `Point`."""
    package: str | None = None
    """The package of a message type, also for relative names; None for primitives."""
    string_bound: int | None = None
    """N of `string<=N`."""
    is_array: bool = False
    array_size: int | None = None
    """N of `[N]` and `[<=N]`; None if unbounded."""
    is_upper_bound: bool = False
    """True for `[<=N]`."""
    kind: Kind = "msg"
    """The folder of a message type: `msg`, except for sections in derived types."""

    @property
    def is_primitive(self) -> bool:
        """Whether the base is a built-in type of ROS 2."""
        return self.package is None

    @property
    def full_name(self) -> str:
        """`geometry_msgs/msg/Point`; for a primitive its own name."""
        return f"{self.package}/{self.kind}/{self.base}" if self.package else self.base

    @property
    def is_fixed_array(self) -> bool:
        """Whether this is `T[N]`."""
        return self.array_size is not None and not self.is_upper_bound

    @property
    def element(self) -> FieldType:
        """The type of one element; the type itself if it is not an array."""
        return FieldType(self.base, self.package, self.string_bound, kind=self.kind)

    def __str__(self) -> str:
        text = f"{self.package}/{self.base}" if self.package else self.base
        if self.string_bound is not None:
            text += f"<={self.string_bound}"
        if self.is_array:
            bound = "<=" if self.is_upper_bound else ""
            text += f"[{bound}{'' if self.array_size is None else self.array_size}]"
        return text


class Field(Struct, frozen=True):
    """One field of a message."""

    name: str
    type: FieldType
    default: Value | None = None
    comment: tuple[str, ...] = ()
    """The comment lines of the field, without their `#`."""
    unit: str | None = None
    """The text of the only `[unit]` in the comment."""
    line: int = 0
    column: int = 0


class Constant(Struct, frozen=True):
    """One named constant of a message."""

    name: str
    type: str
    value: Scalar
    comment: tuple[str, ...] = ()
    unit: str | None = None
    line: int = 0
    column: int = 0


class MessageDef(Struct, frozen=True):
    """A message: a .msg file, one section of a .srv or .action file, or a derived type."""

    package: str
    kind: Kind
    """The folder of its file: `srv` for `AddTwoInts_Request`."""
    name: str
    fields: tuple[Field, ...] = ()
    constants: tuple[Constant, ...] = ()
    comment: tuple[str, ...] = ()
    """The comment lines at the start of the file or section."""
    unit: str | None = None
    """The text of the only `[unit]` in that comment."""

    @property
    def full_name(self) -> str:
        """`example_interfaces/srv/AddTwoInts_Request`."""
        return f"{self.package}/{self.kind}/{self.name}"


class ServiceDef(Struct, frozen=True):
    """A service: its request and its response."""

    package: str
    name: str
    request: MessageDef
    response: MessageDef

    @property
    def full_name(self) -> str:
        """`example_interfaces/srv/AddTwoInts`; `…/action/…` for the services of an action."""
        return f"{self.package}/{self.request.kind}/{self.name}"


class ActionDef(Struct, frozen=True):
    """An action: its goal, its result and its feedback."""

    package: str
    name: str
    goal: MessageDef
    result: MessageDef
    feedback: MessageDef

    @property
    def full_name(self) -> str:
        """`example_interfaces/action/Fibonacci`."""
        return f"{self.package}/action/{self.name}"


Definition: TypeAlias = MessageDef | ServiceDef | ActionDef


def sections(definition: Definition) -> Iterator[MessageDef]:
    """The messages that the text of a definition contains, in the order of the file."""
    match definition:
        case ServiceDef():
            yield from (definition.request, definition.response)
        case ActionDef():
            yield from (definition.goal, definition.result, definition.feedback)
        case _:
            yield definition
