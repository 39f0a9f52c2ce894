"""Lines, comments and separators: the outer shape of a definition's text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

SEPARATOR = "---"

# What opens a bracket is read up to where it ends, also where that makes no unit: a text of a
# million brackets is then read once, not a million times.
_BRACKET = re.compile(r"\[([^,\]]*)(?:\]|,|\Z)")


_RULE = "=" * 80
_HEADING = re.compile(rf"\n{_RULE}\nMSG: (\S+)\n")


class Comment(NamedTuple):
    """The comment of a definition, or of one field or constant."""

    lines: tuple[str, ...] = ()
    unit: str | None = None
    """What stood in the only `[unit]`, which is then no longer part of the lines."""


_NO_COMMENT = Comment()


def split_lines(text: str) -> list[str]:
    """The lines of a text as the official tools see them; columns stay what they are."""
    return text.replace("\t", " ").splitlines()


def leading_comments(lines: Sequence[str]) -> int:
    """How many lines at the start are comments of the whole section."""
    count = 0
    for line in lines:
        if not line.startswith("#"):
            break
        count += 1
    return count


def read_comment(raw_lines: Sequence[str]) -> Comment:
    """Tidy up comment lines (without their `#`): unit taken out, blank lines cut, dedented."""
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
    """The text of a definition, then each needed one under a rule and `MSG: pkg/msg/Name`."""
    return text + "".join(
        f"\n{_RULE}\nMSG: {name}\n{needed_text}" for name, needed_text in needed.items()
    )


def split_full_text(text: str) -> tuple[str, dict[str, str]]:
    """Take apart what `join_full_text` made: the definition's own text, and name → text."""
    own, *rest = _HEADING.split(text)
    return own, dict(zip(rest[::2], rest[1::2], strict=True))


def _dedented(lines: Sequence[str]) -> list[str]:
    # textwrap.dedent compiles a pattern for every indent that it meets.
    lines = [line if line.strip(" ") else "" for line in lines]
    margin = min((len(line) - len(line.lstrip(" ")) for line in lines if line), default=0)
    return [line[margin:] for line in lines]


def _take_unit(text: str) -> tuple[str, str | None]:
    """The text without its only `[unit]`, and that unit; the text as it is where there is none."""
    units = [one for one in _BRACKET.finditer(text) if one[1] and one[0].endswith("]")]
    if len(units) != 1:
        return text, None
    (only,) = units
    start = len(text[: only.start()].rstrip())
    return text.replace(text[start : only.end()], ""), only[1]
