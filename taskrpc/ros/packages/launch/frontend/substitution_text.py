r"""Reads texts with `$(name argument …)`, as XML and YAML launch files contain them.

A backslash makes the next character an ordinary one: `\$(x)`. Arguments are separated by spaces; an
argument in quotes may contain spaces and parentheses. Arguments contain substitutions, too.
"""

from __future__ import annotations

import re
from typing import NamedTuple, TypeAlias

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_MOST_LEVELS = 50


class SubstitutionTextError(ValueError):
    """A text contains a substitution that is not complete."""


class Call(NamedTuple):
    """A substitution in a text."""

    name: str
    arguments: tuple[Template, ...]


Template: TypeAlias = "list[str | Call]"
"""The parts of a text: plain texts and substitutions."""


def parse_text(text: str) -> Template:
    """Return the parts of a text; raises SubstitutionTextError if a substitution does not end."""
    return _Reader(text).template("")


class _Reader:
    """Reads one text from its start to its end."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._position = 0
        self._level = 0

    def template(self, end: str) -> Template:
        """The parts up to one of these characters, which is not read; to the end for none."""
        found: Template = []
        plain: list[str] = []
        while self._position < len(self._text):
            character = self._text[self._position]
            if character in end:
                break
            if self._text.startswith("$(", self._position):
                if plain:
                    found.append("".join(plain))
                    plain = []
                found.append(self._call())
            elif character == "\\" and self._position + 1 < len(self._text):
                plain.append(self._text[self._position + 1])
                self._position += 2
            else:
                plain.append(character)
                self._position += 1
        if plain:
            found.append("".join(plain))
        return found

    def _call(self) -> Call:
        start = self._position
        self._level += 1
        if self._level > _MOST_LEVELS:
            raise SubstitutionTextError(f"more than {_MOST_LEVELS} nested substitutions")
        self._position += len("$(")
        name = _NAME.match(self._text, self._position)
        if name is None:
            raise self._error(start, "expected a name behind $(")
        self._position = name.end()
        arguments = []
        while self._skip_spaces():
            arguments.append(self._argument(start))
        if not self._text.startswith(")", self._position):
            raise self._error(start, "expected ) at its end")
        self._position += 1
        self._level -= 1
        return Call(name[0], tuple(arguments))

    def _skip_spaces(self) -> bool:
        """Go to the next argument; returns whether there is one."""
        before = self._position
        while self._position < len(self._text) and self._text[self._position].isspace():
            self._position += 1
        is_end = self._position == len(self._text) or self._text[self._position] == ")"
        return self._position > before and not is_end

    def _argument(self, start: int) -> Template:
        quote = self._text[self._position]
        if quote not in "'\"":
            return self.template(" \t\r\n)")
        self._position += 1
        found = self.template(quote)
        if self._position == len(self._text):
            raise self._error(start, f"expected {quote} at the end of its argument")
        self._position += 1
        return found

    def _error(self, start: int, expected: str) -> SubstitutionTextError:
        shown = self._text[start : start + 40]
        return SubstitutionTextError(f"{expected}, got {shown!r} at character {start + 1}")
