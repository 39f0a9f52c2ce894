"""The type of a field, from `string<=5[<=3]` to a `FieldType`."""

from __future__ import annotations

from functools import lru_cache

from .mistake import Mistake
from .model import PRIMITIVES, FieldType
from .names import LOWER_RULE, MESSAGE_RULE, bad_at, is_message_name, is_package_name
from .type_slips import message_name_hint, type_hint, type_repair

ROS1_TIME_TYPES = {
    "time": "builtin_interfaces/Time",
    "duration": "builtin_interfaces/Duration",
}
"""ROS 1's own types and what stands for them in ROS 2.

The official parser still reads them, so that a ROS 1 file can be described; every later step
refuses them, here as there.
"""

_BUILT_IN = PRIMITIVES | ROS1_TIME_TYPES.keys()


@lru_cache(maxsize=4096)
def parse_type(text: str, package: str) -> FieldType:
    """Read a type as it stands in a definition of `package`.

    Raises:
        Mistake: with the offset of the offending character in `text`.
    """
    if text in _BUILT_IN:
        return FieldType(text)
    if not text.endswith("]"):
        return _base_type(text, package)
    opening = text.rfind("[")
    if opening < 0:
        raise Mistake(f"expected '[' before the ']' of {text!r}", len(text) - 1)
    if "[" in text[:opening]:
        raise Mistake(
            f"expected one pair of brackets, got {text!r}",
            text.index("["),
            "an array has one dimension; a message with an array inside makes the second",
        )
    base = _base_type(text[:opening], package)
    size_text = text[opening + 1 : -1]
    bounded = size_text.startswith("<=")
    size = _bound(text, opening + 1 + 2 * bounded, len(text) - 1) if size_text else None
    return FieldType(
        base.base,
        base.package,
        base.string_bound,
        is_array=True,
        array_size=size,
        is_upper_bound=bounded,
    )


def _base_type(text: str, package: str) -> FieldType:
    if text in _BUILT_IN:
        return FieldType(text)
    for name in ("string", "wstring"):
        if text.startswith(name + "<="):
            return FieldType(name, None, _bound(text, len(name) + 2, len(text)))
    owner, slash, name = text.rpartition("/")
    if not slash:
        owner = package
    _check_message_type(text, owner, name)
    return FieldType(name, owner)


def _check_message_type(text: str, owner: str, name: str) -> None:
    if "/" in owner or not owner:
        raise Mistake(
            f"expected a built-in type, 'Name' or 'package/Name', got {text!r}",
            hint=type_hint(text),
            repair=type_repair(text),
        )
    if "/" in text and not is_package_name(owner):
        raise Mistake(
            f"expected a package name ({LOWER_RULE}) before the '/', got {owner!r}",
            bad_at(owner, "field"),
            hint=type_hint(text),
        )
    if not is_message_name(name):
        hint = type_hint(text)
        # What is a built-in type's name in another language is wrong as a whole.
        inside = 0 if hint else bad_at(name, "message")
        raise Mistake(
            f"expected a built-in type or the name of a message ({MESSAGE_RULE}), got {name!r}",
            len(text) - len(name) + inside,
            hint or message_name_hint(name),
            type_repair(text),
        )


def _bound(text: str, start: int, end: int) -> int:
    number = text[start:end]
    try:
        value = int(number)
    except ValueError:
        value = 0
    if value <= 0:
        raise Mistake(f"expected a whole number above 0 as the limit, got {number!r}", start)
    return value
