"""The text of a definition: lines, comments, separators, and full texts with dependencies."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from msgspec import Struct

SEPARATOR = "---"

# Python compiles these two patterns when a text first needs them: most programs never do.

# Also matches brackets that are not closed: otherwise the search would start again at each bracket
# and take quadratic time for a text of a million brackets.
_BRACKET = r"\[([^,\]]*)(?:\]|,|\Z)"

_RULE = "=" * 80
_HEADING = rf"\n{_RULE}\nMSG: (\S+)\n"


class Comment(Struct, frozen=True):
    """The comment of a definition, or of one field or constant."""

    lines: tuple[str, ...] = ()
    unit: str | None = None
    """The text of the only `[unit]`, which is removed from the lines."""


_NO_COMMENT = Comment()


def split_lines(text: str) -> list[str]:
    """The lines of a text; tabs become spaces as in the official tools, columns do not change."""
    return text.replace("\t", " ").splitlines()


def leading_comments(lines: Sequence[str]) -> int:
    """The number of lines at the start that are comments of the whole section."""
    count = 0
    for line in lines:
        if not line.startswith("#"):
            break
        count += 1
    return count


def read_comment(raw_lines: Sequence[str]) -> Comment:
    """Clean comment lines (given without `#`): extract the unit, trim blank lines, dedent."""
    if not raw_lines:
        return _NO_COMMENT
    text = "\n".join(raw_lines)
    unit = None
    if "[" in text:
        text, unit = _take_unit(text)
    kept: list[str] = []
    for line in text.splitlines():
        if line or (kept and kept[-1]):
            kept.append(line)
    if kept and not kept[-1]:
        kept.pop()
    return Comment(tuple(_dedented(kept)), unit)


def join_full_text(text: str, needed: Mapping[str, str]) -> str:
    """The text of a definition, then its dependencies, each under a rule and `MSG: pkg/msg/Name`.

    Servers send such a text to clients that do not have the definitions.
    """
    return text + "".join(
        f"\n{_RULE}\nMSG: {name}\n{needed_text}" for name, needed_text in needed.items()
    )


def split_full_text(text: str) -> tuple[str, dict[str, str]]:
    """Split a full text: the text of the definition, and the texts of its dependencies by name."""
    own, *rest = re.split(_HEADING, text)
    return own, dict(zip(rest[::2], rest[1::2], strict=True))


def _dedented(lines: Sequence[str]) -> list[str]:
    # textwrap.dedent is slower: it compiles a pattern for each different indent.
    lines = [line if line.strip(" ") else "" for line in lines]
    margin = min((len(line) - len(line.lstrip(" ")) for line in lines if line), default=0)
    return [line[margin:] for line in lines]


def _take_unit(text: str) -> tuple[str, str | None]:
    """The text without its only `[unit]`, and that unit; the same text and None otherwise."""
    units = [one for one in re.finditer(_BRACKET, text) if one[1] and one[0].endswith("]")]
    if len(units) != 1:
        return text, None
    (only,) = units
    start = len(text[: only.start()].rstrip())
    return text.replace(text[start : only.end()], ""), only[1]
