"""What a writer most likely meant by a value that does not read as one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from .mistake import Mistake, Repair

_SUFFIXED = re.compile(r"([-+]?(?:0x[0-9a-f]+|[\d.]+(?:e[-+]?\d+)?))(?:f|l|u|ul|ll|ull)", re.I)
_WHOLE = re.compile(r"([-+]?\d+)\.0*")
_BOOLS = {"yes": "true", "on": "true", "no": "false", "off": "false"}

Parse = Callable[[str], object]


def put_right(mistake: Mistake, text: str, parse: Parse) -> Mistake:
    """The mistake of the value `text`, with what was meant where that can be told.

    Args:
        mistake: what `parse` has raised for the text; its offset counts in the text.
        text: the value as it stands in the line, up to the end.
        parse: reads a value of the right type, or raises a Mistake.
    """
    comment = re.search(r"(?:^|(?<=\s))//", text)
    if comment:
        mistake.hint = "a comment begins with '#'"
        if _reads(text[: comment.start()].rstrip(), parse) or not comment.start():
            mistake.repair = Repair(comment.start(), comment.end(), "#")
    elif not text:
        mistake.hint = "a value is missing"
    elif not mistake.repair and (meant := meant_value(text, parse)) not in ("", text):
        mistake.hint = f"did you mean {meant}?"
        # What is meant by yes in a definition only its writer can say for sure.
        mistake.repair = None if meant in _BOOLS.values() else Repair(0, len(text), meant)
    return mistake


def meant_value(text: str, parse: Parse) -> str:
    """The value itself where it can be read, else the first likely meaning of it, or ""."""
    return next((one for one in _candidates(text) if _reads(one, parse)), "")


def _candidates(text: str) -> Iterator[str]:
    yield text
    bare = text.rstrip(";, ")
    yield bare
    yield _BOOLS.get(bare.lower(), "")
    for pattern in (_SUFFIXED, _WHOLE):
        if found := pattern.fullmatch(bare):
            yield found[1]
    if re.fullmatch(r"\d+,\d+", bare):
        yield bare.replace(",", ".")
    inner = bare[1:-1] if bare[:1] + bare[-1:] in ("{}", "()") else bare
    if not re.search("[]['\"]", inner):
        yield f"[{inner}]"


def _reads(text: str, parse: Parse) -> bool:
    if not text:
        return False
    try:
        parse(text)
    except Mistake:
        return False
    return True
