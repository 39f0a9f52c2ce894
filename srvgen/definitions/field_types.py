"""Parses the type of a field: `string<=5[<=3]` becomes a `FieldType`."""

from __future__ import annotations

from functools import lru_cache

from ..errors import InvalidText
from .model import PRIMITIVES, FieldType
from .names import is_message_name, is_package_name

ROS1_TIME_TYPES = {
    "time": "builtin_interfaces/Time",
    "duration": "builtin_interfaces/Duration",
}
"""The types that only ROS 1 has, and their replacements in ROS 2.

The official parser accepts them, so that a ROS 1 file can be described; every later step of the
official tools refuses them, and so does srvgen.
"""

_BUILT_IN = PRIMITIVES | ROS1_TIME_TYPES.keys()


class InvalidTypeName(InvalidText):
    """A type is neither built in nor a valid message name.

    `diagnostics` gives the precise message and a hint; only refused lines pay for that.

    Attributes:
        text: the type without the brackets of an array.
        package, name: the parts of the message type that it would be.
    """

    def __init__(self, text: str, package: str, name: str) -> None:
        super().__init__(f"expected a built-in type, 'Name' or 'package/Name', got {text!r}")
        self.text = text
        self.package = package
        self.name = name


@lru_cache(maxsize=4096)
def parse_type(text: str, package: str) -> FieldType:
    """Parse the text of a type in a definition of `package`.

    Raises:
        InvalidText: the text is not a type; `offset` counts in `text`.
    """
    if text in _BUILT_IN:
        return FieldType(text)
    if not text.endswith("]"):
        return _base_type(text, package)
    opening = text.rfind("[")
    if opening < 0:
        raise InvalidText(f"expected '[' before the ']' of {text!r}", len(text) - 1)
    if "[" in text[:opening]:
        raise InvalidText(
            f"expected one pair of brackets, got {text!r}",
            text.index("["),
            "an array has one dimension; use a message with an array for the second",
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
    written_package, slash, name = text.rpartition("/")
    if slash:
        package = written_package
    _check_message_type(text, package, name)
    return FieldType(name, package)


def _check_message_type(text: str, package: str, name: str) -> None:
    # The parser reports an invalid package of the file itself, not at every field.
    has_package = is_package_name(package) if "/" in text else package and "/" not in package
    if not has_package or not is_message_name(name):
        raise InvalidTypeName(text, package, name)


def _bound(text: str, start: int, end: int) -> int:
    number = text[start:end]
    try:
        value = int(number)
    except ValueError:
        value = 0
    if value <= 0:
        raise InvalidText(f"expected a whole number above 0 as the limit, got {number!r}", start)
    return value
