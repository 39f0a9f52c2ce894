"""A message as ros2 prints it: YAML, or values between commas; long parts cut off."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from typing import Any

import msgspec

_FIXED = re.compile(r".+\[\d+\]")


class Cut(msgspec.Struct, frozen=True):
    """What of a message is shown."""

    length: int | None = 128
    """The most characters of a text and elements of an array; None for all."""
    arrays: bool = True
    """Else only what they hold, and how many."""
    texts: bool = True
    """Else only how long they are."""


def yaml_of(value: Any, cut: Cut, *, flow: bool = False) -> str:
    """A message, or one of its fields, as a YAML document that ends in a line break."""
    shown = plain(value, cut)
    if isinstance(shown, dict):
        import yaml

        return yaml.dump(
            shown,
            allow_unicode=True,
            default_flow_style=flow,
            sort_keys=False,
            width=sys.maxsize,
        )
    return f"{shown}\n"


def csv_of(value: Any, cut: Cut) -> str:
    """All values of a message, or of one of its fields, in order."""
    shown = plain(value, cut, byte=_byte_itself)
    return _csv(shown)


def _csv(shown: Any) -> str:
    if isinstance(shown, dict):
        return ",".join(map(_csv, shown.values()))
    return ",".join(map(_csv, shown)) if isinstance(shown, list) else str(shown)


def _byte_itself(value: bytes) -> Any:
    return value


def _byte_as_text(value: bytes) -> str:
    return value.decode("latin-1")


def plain(
    value: Any, cut: Cut, type_: str = "", byte: Callable[[bytes], Any] = _byte_as_text
) -> Any:
    """Dicts, lists and what YAML knows instead of messages, arrays and bytes."""
    if hasattr(value, "_FIELDS"):
        types = value.get_fields_and_field_types()
        attributes = value.__struct_fields__  # a keyword's has an underscore more
        return {
            name: plain(getattr(value, attribute), cut, types[name], byte)
            for (name, _), attribute in zip(value._FIELDS, attributes, strict=True)
        }
    if isinstance(value, str):
        return _text(value, cut)
    if isinstance(value, bool | int | float | dict):
        return value
    if isinstance(value, bytes) and type_ in ("", "octet"):
        return byte(value)
    return _array(list(value), cut, type_, byte)


def _text(value: str, cut: Cut) -> str:
    if not cut.texts:
        return f"<string length: <{len(value)}>>"
    if cut.length is not None and len(value) > cut.length:
        return value[: cut.length] + "..."
    return value


def _array(values: list[Any], cut: Cut, type_: str, byte: Callable[[bytes], Any]) -> Any:
    if not cut.arrays and type_:
        if _FIXED.fullmatch(type_):
            return f"<array type: {type_}>"
        element = type_.removeprefix("sequence<").removesuffix(">").partition(",")[0]
        return f"<sequence type: {element}, length: {len(values)}>"
    shown = [plain(each, cut, "", byte) for each in values[: cut.length]]
    return shown if len(shown) == len(values) else [*shown, "..."]
