"""Python source of literals and docstrings, safe for whatever a definition may contain."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from ..definitions.model import Scalar

_WIDTH = 100
_UNUSUAL = re.compile("[^ -~]")


def literal(value: Scalar | bytes) -> str:
    """A value's source; needs `import math as _math` for what is not finite."""
    if isinstance(value, str):
        return text_literal(value)
    if isinstance(value, bytes):
        return f'b"\\x{value[0]:02x}"'
    if isinstance(value, float) and not math.isfinite(value):
        return "_math.nan" if math.isnan(value) else f"{'-' if value < 0 else ''}_math.inf"
    return repr(value)


def text_literal(text: str) -> str:
    """A string's source, in double quotes."""
    return '"' + _escaped(text).replace('"', '\\"') + '"'


def definition_literal(text: str) -> str:
    """A long text's source, one line of it on each line of the source."""
    lines = [f"    {text_literal(line)}" for line in text.splitlines(keepends=True)]
    return "\n".join(["(", *lines, ")"]) if len(lines) > 1 else text_literal(text)


def docstring(lines: Sequence[str], indent: str) -> list[str]:
    """The lines as a docstring statement."""
    body = [_docstring_line(line) for line in lines]
    if len(body) == 1 and len(indent) + len(body[0]) + 6 <= _WIDTH:
        return [f'{indent}"""{body[0]}"""']
    rest = [(indent + line).rstrip() for line in body[1:]]
    return [f'{indent}"""{body[0]}', *rest, f'{indent}"""']


def _docstring_line(line: str) -> str:
    text = _escaped(line.rstrip())
    return text.replace('"', '\\"') if '"""' in text or text.endswith('"') else text


def _escaped(text: str) -> str:
    # Everything that does not print is escaped: a definition must not be able to end a literal,
    # nor to show one thing in an editor and be another.
    text = text.replace("\\", "\\\\").replace("\n", "\\n")
    return text if text.isprintable() else _UNUSUAL.sub(_escaped_character, text)


def _escaped_character(match: re.Match[str]) -> str:
    char = match[0]
    return char if char.isprintable() else char.encode("unicode_escape").decode()
