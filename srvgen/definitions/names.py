"""The rules for names, full type names in parts, and suggestions for misspelt names."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal, NamedTuple, cast, get_args

from ..errors import DefinitionError
from .model import Kind

# Python compiles a pattern at its first use: a program needs few of them.
_LOWER = r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*"
_MESSAGE = r"[A-Z][A-Za-z0-9]*"
_CONSTANT = r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*"
_WORD_ENDS = r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|[^A-Za-z0-9]+"
_KINDS = frozenset(get_args(Kind))
# The official tools remove each suffix once, in this order.
_SECTION_SUFFIXES = ("_Request", "_Response", "_Goal", "_Result", "_Feedback")
_SERVICE_PARTS = ("_Event", "_Request", "_Response")
_PARTS: dict[Kind, tuple[str, ...]] = {
    "msg": (),
    "srv": _SERVICE_PARTS,
    "action": tuple(
        f"_{service}{part}" for service in ("GetResult", "SendGoal") for part in _SERVICE_PARTS
    ),
}
"""Suffixes of the classes that the official tools export beside the class of an interface."""

LOWER_RULE = "lower-case letters, digits and single underscores, with a letter first"
MESSAGE_RULE = "letters and digits, with a capital first"
CONSTANT_RULE = "capitals, digits and single underscores, with a letter first"


class TypeName(NamedTuple):
    """A full type name in its three parts."""

    package: str
    kind: Kind
    name: str

    def renamed(self, name: str) -> TypeName:
        """The type of that name in the same folder of the same package."""
        return TypeName(self.package, self.kind, name)

    def __str__(self) -> str:
        return f"{self.package}/{self.kind}/{self.name}"


def names_in_folder(kind: Kind, name: str) -> list[str]:
    """The exported classes of an interface: `AddTwoInts`, `AddTwoInts_Request`, …"""
    return [name, *(f"{name}{part}" for part in _PARTS[kind])]


def is_package_name(name: str) -> bool:
    """Whether ROS 2 accepts the name for a package."""
    return re.fullmatch(_LOWER, name) is not None


def is_field_name(name: str) -> bool:
    """Whether ROS 2 accepts the name for a field."""
    return re.fullmatch(_LOWER, name) is not None


def is_message_name(name: str) -> bool:
    """Whether ROS 2 accepts the name for a message or for a section of a service or action."""
    name = name.removeprefix("Sample_")
    for suffix in _SECTION_SUFFIXES:
        name = name.removesuffix(suffix)
    return re.fullmatch(_MESSAGE, name) is not None


def is_constant_name(name: str) -> bool:
    """Whether ROS 2 accepts the name for a constant."""
    return re.fullmatch(_CONSTANT, name) is not None


def first_invalid(name: str, kind: Literal["field", "constant", "message"]) -> int:
    """The offset of the first invalid character of a name; use "field" for packages too."""
    rule = {"field": _LOWER, "constant": _CONSTANT, "message": _MESSAGE}[kind]
    found = re.match(rule, name)
    end = found.end() if found else 0
    # An underscore is valid before a letter, so the invalid character is the one after it.
    only_last = end + 1 >= len(name) or not found
    return end if only_last or kind == "message" or name[end] != "_" else end + 1


def snake_case(name: str) -> str:
    """`maxSpeed` → `max_speed`: a name as a field or a package has it."""
    return re.sub("_+", "_", re.sub(_WORD_ENDS, "_", name)).strip("_").lower()


def camel_case(name: str) -> str:
    """`add_two_ints` → `AddTwoInts`: a name as a type has it."""
    return "".join(word[:1].upper() + word[1:] for word in re.split("[^A-Za-z0-9]+", name))


def split_type_name(text: str) -> TypeName:
    """Split `pkg/srv/Name` into its parts.

    Raises:
        DefinitionError: the text is not three valid names with `/` between them.
    """
    parts = text.split("/")
    if len(parts) == 3:
        package, kind, name = parts
        if kind in _KINDS and is_package_name(package) and name.isidentifier():
            return TypeName(package, cast("Kind", kind), name)
    raise DefinitionError(
        f"expected a type name such as 'example_interfaces/srv/AddTwoInts', got {text!r}"
    )


def similar_names(name: str, known: Iterable[str]) -> list[str]:
    """At most three known names that resemble a misspelt one, the most similar first."""
    import difflib  # only errors need it

    by_lower = {one.lower(): one for one in known}
    # An almost equal name should not be offered beside weaker candidates.
    for cutoff in (0.92, 0.7):
        found = difflib.get_close_matches(name.lower(), by_lower, 3, cutoff)
        if found:
            return [by_lower[one] for one in found]
    return []


def is_one_typo(one: str, other: str) -> bool:
    """Whether the names differ by one letter: missing, extra, wrong or swapped with the next."""
    while one and other and one[0] == other[0]:
        one, other = one[1:], other[1:]
    if one[1:] == other[1:] or one[1:] == other or one == other[1:]:
        return one != other
    return one[:2] == other[1::-1] and one[2:] == other[2:]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint with the known names that resemble `name`, or ""."""
    found = similar_names(name, known)
    return f"did you mean {' or '.join(found)}?" if found else ""
