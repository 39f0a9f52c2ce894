"""Turns texts with `$(…)` into substitutions."""

from __future__ import annotations

from typing import Any

from ..substitution import Substitution, TextSubstitution
from .expose import substitution_parsers
from .hints import substitution_hint
from .substitution_text import Call, Template, parse_text


def parse_substitution(text: str) -> list[Substitution]:
    """Return the substitutions of a text; raises RuntimeError for an unknown one."""
    return _substitutions(parse_text(text)) or [TextSubstitution(text="")]


def parse_if_substitutions(value: Any) -> Any:
    """Return the substitutions of a text or of each text in a list; other values as they are."""
    if isinstance(value, str):
        return parse_substitution(value)
    return [parse_if_substitutions(each) for each in value] if isinstance(value, list) else value


def _substitutions(template: Template) -> list[Substitution]:
    return [
        TextSubstitution(text=part) if isinstance(part, str) else _called(part) for part in template
    ]


def _called(call: Call) -> Substitution:
    build = substitution_parsers.get(call.name)
    if build is None:
        hint = substitution_hint(call.name, substitution_parsers)
        raise RuntimeError(f"Unknown substitution: {call.name}{hint}")
    arguments = [_substitutions(each) or [TextSubstitution(text="")] for each in call.arguments]
    try:
        found: Substitution = build(*arguments)
    except TypeError as error:
        raise RuntimeError(f"substitution '{call.name}': {_shortened(error)}") from None
    return found


def _shortened(error: TypeError) -> str:
    """Python's text about wrong arguments, without the name of the function."""
    return str(error).partition(") ")[2] or str(error)
