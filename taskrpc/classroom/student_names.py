"""Students' names as people write them, and the accounts that stand for them.

An account's name travels in tokens and becomes a ROS namespace, so it is ASCII. A student's name
may be in any script: it is shown as written, and its account is derived from it, or numbered.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable

_MOST = 100
_LONGEST_ACCOUNT = 40
_MARKS = " .,'\N{RIGHT SINGLE QUOTATION MARK}·_@+-()"
"""Characters that names may have beside letters and digits."""
_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"
"""Invisible parts of Persian and Indic names; other invisible characters could disguise a name."""
_SPELLINGS = dict(
    zip(
        map(ord, "ßæÆœŒþÞøØłŁđĐð\N{LATIN SMALL LETTER DOTLESS I}"),
        "ss ae Ae oe Oe th Th o O l L d D d i".split(),
        strict=True,
    )
)
"""Latin letters that Unicode does not decompose into an ASCII letter and an accent."""
_NUMBERED = "student"


def cleaned(name: str) -> str:
    """A name with single spaces, and each letter in one form however it was typed."""
    return unicodedata.normalize("NFC", " ".join(name.split()))


def why_no_student(name: str) -> str:
    """Why a cleaned name is not valid for a student, "" if it is."""
    # L, M, N: letters, marks and numbers.
    kinds = [unicodedata.category(letter) for letter in name]
    is_right = all(
        kind[0] in "LMN" or letter in _MARKS or letter in _JOINERS
        for kind, letter in zip(kinds, name, strict=True)
    )
    if is_right and len(name) <= _MOST and any(kind[0] in "LN" for kind in kinds):
        return ""
    return (
        f"a student's name: expected 1 to {_MOST} letters, digits, spaces or any of"
        f" {_MARKS.strip()}, got {name!r}"
    )


def account_for(name: str, is_free: Callable[[str], bool]) -> str:
    """A free account for a student's name: `Jose` for José, `student1` for 小明."""
    plain = unicodedata.normalize("NFKD", name.translate(_SPELLINGS))
    letters = plain.encode("ascii", "ignore").decode()
    base = re.sub(r"[^A-Za-z0-9]+", "_", letters).strip("_")[:_LONGEST_ACCOUNT]
    if base and is_free(base):
        return base
    number = 2 if base else 1
    while not is_free(account := f"{base or _NUMBERED}{number}"):
        number += 1
    return account
