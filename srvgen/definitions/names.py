"""The rules for names, and how full type names are taken apart."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal, NamedTuple, cast, get_args

from ..errors import DefinitionError
from .model import Kind

_LOWER = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")
_MESSAGE = re.compile(r"[A-Z][A-Za-z0-9]*")
_CONSTANT = re.compile(r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*")
_WORD_ENDS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|[^A-Za-z0-9]+")
_UNDERSCORES = re.compile("_+")
_KINDS = frozenset(get_args(Kind))
# Each is taken off once, in this order, as the official tools do.
_SECTION_SUFFIXES = ("_Request", "_Response", "_Goal", "_Result", "_Feedback")
_SERVICE_PARTS = ("_Event", "_Request", "_Response")
_PARTS: dict[Kind, tuple[str, ...]] = {
    "msg": (),
    "srv": _SERVICE_PARTS,
    "action": tuple(
        f"_{service}{part}" for service in ("GetResult", "SendGoal") for part in _SERVICE_PARTS
    ),
}
"""What the folder modules of the official tools have beside a class, and nothing more."""

LOWER_RULE = "lower-case letters, digits and single underscores, with a letter first"
MESSAGE_RULE = "letters and digits, with a capital first"
CONSTANT_RULE = "capitals, digits and single underscores, with a letter first"


class TypeName(NamedTuple):
    """A full type name in its three parts."""

    package: str
    kind: Kind
    name: str

    def __str__(self) -> str:
        return f"{self.package}/{self.kind}/{self.name}"


def names_in_folder(kind: Kind, name: str) -> list[str]:
    """The classes of an interface that its folder module has: `AddTwoInts`, its request, …"""
    return [name, *(f"{name}{part}" for part in _PARTS[kind])]


def is_package_name(name: str) -> bool:
    """Whether ROS 2 accepts this as the name of a package."""
    return _LOWER.fullmatch(name) is not None


def is_field_name(name: str) -> bool:
    """Whether ROS 2 accepts this as the name of a field."""
    return _LOWER.fullmatch(name) is not None


def is_message_name(name: str) -> bool:
    """Whether this can name a message, one section of a service or action included."""
    name = name.removeprefix("Sample_")
    for suffix in _SECTION_SUFFIXES:
        name = name.removesuffix(suffix)
    return _MESSAGE.fullmatch(name) is not None


def is_constant_name(name: str) -> bool:
    """Whether ROS 2 accepts this as the name of a constant."""
    return _CONSTANT.fullmatch(name) is not None


def bad_at(name: str, kind: Literal["field", "constant", "message"]) -> int:
    """Where a refused name of this kind stops being one; a package's is as a field's."""
    rule = {"field": _LOWER, "constant": _CONSTANT, "message": _MESSAGE}[kind]
    found = rule.match(name)
    end = found.end() if found else 0
    # An underscore is fine where a letter follows, so what follows is what is wrong.
    only_last = end + 1 >= len(name) or not found
    return end if only_last or kind == "message" or name[end] != "_" else end + 1


def snake_case(name: str) -> str:
    """`maxSpeed` → `max_speed`; what a camel-case name looks like as a field or package."""
    return _UNDERSCORES.sub("_", _WORD_ENDS.sub("_", name)).strip("_").lower()


def camel_case(name: str) -> str:
    """`add_two_ints` → `AddTwoInts`; what a file name looks like as the name of a type."""
    return "".join(word[:1].upper() + word[1:] for word in re.split("[^A-Za-z0-9]+", name))


def split_type_name(text: str) -> TypeName:
    """Take `pkg/srv/Name` apart.

    Raises:
        DefinitionError: where the text is not three valid names with `/` between them.
    """
    parts = text.split("/")
    if len(parts) == 3:
        package, kind, name = parts
        if kind in _KINDS and is_package_name(package) and name.isidentifier():
            return TypeName(package, cast("Kind", kind), name)
    raise DefinitionError(
        f"expected a type name such as 'example_interfaces/srv/AddTwoInts', got {text!r}"
    )


def near(name: str, known: Iterable[str]) -> list[str]:
    """The known names that a misspelt one most resembles, the best first, at most three."""
    import difflib  # only a mistake needs it

    by_lower = {one.lower(): one for one in known}
    # What is as good as right should not be offered beside what only resembles it.
    for likeness in (0.92, 0.7):
        found = difflib.get_close_matches(name.lower(), by_lower, 3, likeness)
        if found:
            return [by_lower[one] for one in found]
    return []


def is_one_slip(one: str, other: str) -> bool:
    """Whether a letter left out, put in, mistaken or swapped with the next makes the difference."""
    while one and other and one[0] == other[0]:
        one, other = one[1:], other[1:]
    if one[1:] == other[1:] or one[1:] == other or one == other[1:]:
        return one != other
    return one[:2] == other[1::-1] and one[2:] == other[2:]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint that names what resembles `name`, or "" where nothing does."""
    found = near(name, known)
    return f"did you mean {' or '.join(found)}?" if found else ""
