"""The objects in `SLOT_TYPES` of a ROS message class, named as in `rosidl_parser.definition`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

SIGNED_EXPLICIT_INTEGER_TYPES = ("int8", "int16", "int32", "int64")
UNSIGNED_EXPLICIT_INTEGER_TYPES = ("uint8", "uint16", "uint32", "uint64")
EXPLICIT_INTEGER_TYPES = SIGNED_EXPLICIT_INTEGER_TYPES + UNSIGNED_EXPLICIT_INTEGER_TYPES
SIGNED_NONEXPLICIT_INTEGER_TYPES = ("short", "long", "long long")
UNSIGNED_NONEXPLICIT_INTEGER_TYPES = tuple(
    f"unsigned {name}" for name in SIGNED_NONEXPLICIT_INTEGER_TYPES
)
NONEXPLICIT_INTEGER_TYPES = SIGNED_NONEXPLICIT_INTEGER_TYPES + UNSIGNED_NONEXPLICIT_INTEGER_TYPES
SIGNED_INTEGER_TYPES = SIGNED_NONEXPLICIT_INTEGER_TYPES + SIGNED_EXPLICIT_INTEGER_TYPES
UNSIGNED_INTEGER_TYPES = UNSIGNED_NONEXPLICIT_INTEGER_TYPES + UNSIGNED_EXPLICIT_INTEGER_TYPES
INTEGER_TYPES = SIGNED_INTEGER_TYPES + UNSIGNED_INTEGER_TYPES
FLOATING_POINT_TYPES = ("float", "double", "long double")
CHARACTER_TYPES = ("char", "wchar")
BOOLEAN_TYPE = "boolean"
OCTET_TYPE = "octet"
BASIC_TYPES = (
    *INTEGER_TYPES,
    *FLOATING_POINT_TYPES,
    *CHARACTER_TYPES,
    BOOLEAN_TYPE,
    OCTET_TYPE,
)


class AbstractType:
    """The type of a field."""


class AbstractNestableType(AbstractType):
    """A type that array elements can have."""


@dataclass
class BasicType(AbstractNestableType):
    """A number, a boolean or a byte."""

    typename: str
    """One of `BASIC_TYPES`."""


@dataclass
class NamespacedType(AbstractNestableType):
    """A message."""

    namespaces: list[str]
    """`["geometry_msgs", "msg"]`."""
    name: str

    def __init__(self, namespaces: Iterable[str], name: str) -> None:
        self.namespaces = list(namespaces)
        self.name = name

    def namespaced_name(self) -> tuple[str, ...]:
        """`("geometry_msgs", "msg", "Point")`."""
        return (*self.namespaces, self.name)


class AbstractGenericString(AbstractNestableType):
    """A `string` or a `wstring`."""

    def has_maximum_size(self) -> bool:
        """Whether the string is bounded, so that it has a `maximum_size`."""
        return hasattr(self, "maximum_size")


class AbstractString(AbstractGenericString):
    """A `string`."""


class AbstractWString(AbstractGenericString):
    """A `wstring`."""


@dataclass
class BoundedString(AbstractString):
    """A `string<=N`."""

    maximum_size: int


@dataclass
class UnboundedString(AbstractString):
    """A `string` of any length."""


@dataclass
class BoundedWString(AbstractWString):
    """A `wstring<=N`."""

    maximum_size: int


@dataclass
class UnboundedWString(AbstractWString):
    """A `wstring` of any length."""


@dataclass
class AbstractNestedType(AbstractType):
    """An array of any kind."""

    value_type: AbstractNestableType
    """The type of the elements."""

    def has_maximum_size(self) -> bool:
        """Whether the number of elements is bounded."""
        return True


@dataclass
class Array(AbstractNestedType):
    """A `T[N]`."""

    size: int


class AbstractSequence(AbstractNestedType):
    """An array without a fixed length."""


@dataclass
class BoundedSequence(AbstractSequence):
    """A `T[<=N]`."""

    maximum_size: int


@dataclass
class UnboundedSequence(AbstractSequence):
    """A `T[]`."""

    def has_maximum_size(self) -> bool:
        """False."""
        return False


_NAMES = {
    "bool": BOOLEAN_TYPE,
    "byte": OCTET_TYPE,
    "char": "uint8",
    "float32": "float",
    "float64": "double",
}
_TEXTS: dict[str, tuple[Any, Any]] = {
    "string": (BoundedString, UnboundedString),
    "wstring": (BoundedWString, UnboundedWString),
}


def slot_type(type_: str, nested: Any = None) -> AbstractType:
    """The type of a field as a definition spells it: `float64[<=3]`.

    Args:
        type_: a type, as in the `_FIELDS` of a message class.
        nested: the class of the field's messages, where it holds some.
    """
    element, bracket, size = type_.removesuffix("]").partition("[")
    base, bounded, length = element.partition("<=")
    kind: AbstractNestableType
    if nested is not None:
        package, folder, name = nested._TYPE.split("/")
        kind = NamespacedType([package, folder], name)
    elif base in _TEXTS:
        with_bound, without = _TEXTS[base]
        kind = with_bound(int(length)) if bounded else without()
    else:
        kind = BasicType(_NAMES.get(base, base))
    if not bracket:
        return kind
    if not size:
        return UnboundedSequence(kind)
    if size.startswith("<="):
        return BoundedSequence(kind, int(size.removeprefix("<=")))
    return Array(kind, int(size))
