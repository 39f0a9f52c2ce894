"""A definition as text with what its fields contain, as `ros2 interface show` prints it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

from .definitions.lines import SEPARATOR
from .definitions.model import Definition, sections

Comments = Literal["own", "all", "none"]
"""Whose comments are shown: of the definition itself, of the nested ones too, or nobody's."""

Lookup = Callable[[str], tuple[str, Definition]]


def show(name: str, lookup: Lookup, *, comments: Comments = "own") -> Iterator[str]:
    """The lines of a definition, each nested one under its field and indented by a tab.

    Args:
        name: the full name of the type.
        lookup: gives text and definition of a full name. No type may contain itself.
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
