"""Shows a definition to programs (`srvgen describe`) and to people (`srvgen show`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Literal

from .definitions.lines import SEPARATOR
from .definitions.model import (
    ActionDef,
    Constant,
    Definition,
    Field,
    MessageDef,
    ServiceDef,
    Value,
    sections,
)

Comments = Literal["own", "all", "none"]
"""Which comments are shown: of the definition itself, also of nested ones, or none."""

Lookup = Callable[[str], tuple[str, Definition]]


def describe(definition: Definition) -> dict[str, Any]:
    """A definition as plain data for `json.dumps(..., allow_nan=False)`.

    Nested definitions appear only by name. Strings keep their backslash escapes, as in the
    official parser; a number that JSON does not have is `{"$float": "nan"}`.
    """
    return {"type": definition.full_name, "spec": _spec(definition)}


def show(name: str, lookup: Lookup, *, comments: Comments = "own") -> Iterator[str]:
    """The lines of a definition; nested definitions follow their field, indented by a tab.

    Args:
        name: the full name of the type.
        lookup: returns the text and the definition of a full name. No type may contain itself.
        comments: whose comments and blank lines are kept.
    """
    text, definition = lookup(name)
    kept = comments != "none"
    nested = {
        field.line: field.type.full_name
        for message in sections(definition)
        for field in message.fields
        if field.type.package
    }
    for number, line in enumerate(text.splitlines(), 1):
        shown = line.rstrip() if kept or line == SEPARATOR else line.partition("#")[0].rstrip()
        if shown or kept:
            yield shown
        if number in nested:
            inner = show(nested[number], lookup, comments="all" if comments == "all" else "none")
            yield from (f"\t{one}" if one else "" for one in inner)


def _spec(definition: Definition) -> dict[str, Any]:
    match definition:
        case ServiceDef():
            named = {"request": definition.request, "response": definition.response}
        case ActionDef():
            named = {
                "goal": definition.goal,
                "result": definition.result,
                "feedback": definition.feedback,
            }
        case _:
            named = {"message": definition}
    return {section: _message(message) for section, message in named.items()}


def _message(message: MessageDef) -> dict[str, Any]:
    return {
        "fields": [_field(field) for field in message.fields],
        "constants": [_constant(constant) for constant in message.constants],
    }


def _field(field: Field) -> dict[str, Any]:
    kind = field.type
    return {
        "name": field.name,
        "type": kind.base,
        "pkg": kind.package,
        "string_upper_bound": kind.string_bound,
        "is_array": kind.is_array,
        "array_size": kind.array_size,
        "is_upper_bound": kind.is_upper_bound,
        "type_string": str(kind),
        "default": None if field.default is None else _plain(field.default),
    }


def _constant(constant: Constant) -> dict[str, Any]:
    return {
        "name": constant.name,
        "type": constant.type,
        "value": _plain(constant.value),
    }


def _plain(value: Value) -> Any:
    if isinstance(value, tuple):
        return [_plain(element) for element in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"$float": str(value)}
    return value
