"""Limits on definitions: other programs send definitions too, and must not exhaust this one."""

from __future__ import annotations

from collections.abc import Mapping

from ..errors import DefinitionError
from .model import Field, FieldType, MessageDef

TEXT = 2**20
"""Characters of a definition, including the nested ones that a peer sends with it."""
ENTRIES = 10_000
"""Fields, constants and elements of array defaults in one file."""
PROBLEMS = 1_000
"""Problems reported for one file."""
DEPTH = 64
"""Levels of nested types."""
NESTED = 500
"""Nested definitions in one full text."""
MEMORY = 2**26
"""Approximate bytes of a message whose fields have their defaults."""

_OBJECT = 64
_REFERENCE = 8
_SIZES = {
    "char": 1,
    "float32": 4,
    **{f"{sign}int{bits}": bits // 8 for sign in ("", "u") for bits in (8, 16, 32, 64)},
}


def check_text(text: str, path: str) -> None:
    """Refuse a text that no file with definitions has: it is too long, or not Unicode.

    Raises:
        DefinitionError: has `path` as the name of the file.
    """
    if len(text) > TEXT:
        most = f"expected at most {TEXT:,} characters of definitions, got {len(text):,}"
        raise DefinitionError(most, path=path)
    if text.isascii():
        return
    try:
        text.encode()
    except UnicodeEncodeError as error:
        shown = (text[: error.start] + "\N{REPLACEMENT CHARACTER}").splitlines()
        raise DefinitionError(
            "expected text that UTF-8 can encode, "
            f"got a lone surrogate (U+{ord(text[error.start]):04X})",
            path=path,
            line=len(shown),
            column=len(shown[-1]),
            source_line=shown[-1],
        ) from None


def default_memory(message: MessageDef, nested: Mapping[str, int]) -> int:
    """Approximate bytes of a new message; `nested` has the bytes of other messages."""
    return _OBJECT + sum(field_memory(nested, field) for field in message.fields)


def field_memory(nested: Mapping[str, int], field: Field) -> int:
    """Approximate bytes of one field of a new message."""
    type_ = field.type
    if not type_.is_array:
        return _element_memory(type_, nested)
    if type_.is_fixed_array and type_.array_size:
        return _OBJECT + type_.array_size * _element_memory(type_, nested)
    count = len(field.default) if isinstance(field.default, tuple) else 0
    return _OBJECT + count * _REFERENCE


def _element_memory(type_: FieldType, nested: Mapping[str, int]) -> int:
    if type_.is_primitive:
        return _SIZES.get(type_.base, _REFERENCE)
    return nested.get(type_.full_name, _OBJECT)
