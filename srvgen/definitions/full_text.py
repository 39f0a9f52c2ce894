"""One text for a definition and all that it needs, as servers hand it to clients that lack it."""

from __future__ import annotations

import re
from collections.abc import Mapping

_RULE = "=" * 80
_HEADING = re.compile(rf"\n{_RULE}\nMSG: (\S+)\n")


def join_full_text(text: str, needed: Mapping[str, str]) -> str:
    """The text of a definition, then each needed one under a rule and `MSG: pkg/msg/Name`."""
    return text + "".join(
        f"\n{_RULE}\nMSG: {name}\n{needed_text}" for name, needed_text in needed.items()
    )


def split_full_text(text: str) -> tuple[str, dict[str, str]]:
    """Take apart what `join_full_text` made: the definition's own text, and name → text."""
    own, *rest = _HEADING.split(text)
    return own, dict(zip(rest[::2], rest[1::2], strict=True))
