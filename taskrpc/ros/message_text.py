"""A message as ros2 prints it: YAML or comma-separated values, with long parts abbreviated."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from typing import Any

import msgspec

_ARRAY = re.compile(
    r"sequence<(?P<item>.+?)(?:, (?P<bound>\d+))?>|(?P<element>.+)\[(?P<size>\d+)\]"
)


class Cut(msgspec.Struct, frozen=True):
    """How much of a message is shown."""

    length: int | None = 128
    """Most characters of a string and most elements of an array; None for all."""
    arrays: bool = True
    """False shows only the type and the length of an array."""
    texts: bool = True
    """False shows only the length of a string."""


def yaml_of(value: Any, cut: Cut, *, flow: bool = False) -> str:
    """A message, or one of its fields, as a YAML document with a line break at the end."""
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
    """The values of a message, or of one of its fields, in order and comma-separated."""
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
    """A value as dicts, lists and scalars that YAML can represent."""
    if hasattr(value, "_FIELDS"):
        types = value.get_fields_and_field_types()
        attributes = value.__struct_fields__  # with `_` appended to Python keywords
        shown = {}
        for (name, _), attribute in zip(value._FIELDS, attributes, strict=True):
            field = getattr(value, attribute)
            abbreviated = "" if cut.arrays else _abbreviated(value, name, types[name], field)
            shown[name] = abbreviated or plain(field, cut, types[name], byte)
        return shown
    if isinstance(value, str):
        return _text(value, cut)
    if isinstance(value, bool | int | float | dict):
        return value
    if isinstance(value, bytes) and type_ in ("", "octet"):
        return byte(value)
    items = value.tolist() if hasattr(value, "tolist") else list(value)  # Python's numbers
    return _array(items, cut, byte)


def _text(value: str, cut: Cut) -> str:
    if not cut.texts:
        return f"<string length: <{len(value)}>>"
    if cut.length is not None and len(value) > cut.length:
        return value[: cut.length] + "..."
    return value


def _abbreviated(message: Any, name: str, type_: str, values: Any) -> str:
    """An array field as its type and length, as rosidl_runtime_py writes it; "" for others."""
    found = _ARRAY.fullmatch(type_)
    if found is None:
        return ""
    nested = message._NESTED.get(name)
    element = (
        (found["item"] or found["element"]).partition("<")[0] if nested is None else nested._TYPE
    )
    if found["size"]:
        return f"<array type: {element}[{found['size']}]>"
    bound = f"[{found['bound']}]" if found["bound"] else ""
    return f"<sequence type: {element}{bound}, length: {len(values)}>"


def _array(values: list[Any], cut: Cut, byte: Callable[[bytes], Any]) -> Any:
    shown = [plain(each, cut, "", byte) for each in values[: cut.length]]
    return shown if len(shown) == len(values) else [*shown, "..."]
