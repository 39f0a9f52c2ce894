"""From the name of a student, in any script, to an account and a namespace."""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections.abc import Callable

from taskrpc.errors import TaskRpcError
from taskrpc.spi import Row, account_name_problem

_MOST = 100
_LONGEST_ACCOUNT = 40
_MARKS = " .,'\N{RIGHT SINGLE QUOTATION MARK}·_@+-()"
"""The characters of names besides letters and digits."""
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
    """Return a name with single spaces and in Unicode's composed form (NFC)."""
    return unicodedata.normalize("NFC", " ".join(name.split()))


def student_name_problem(name: str) -> str:
    """Return why a cleaned name is not valid for a student, "" if it is valid."""
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
    """Return a free account name for a student: `Jose` for José, `student1` for 小明."""
    plain = unicodedata.normalize("NFKD", name.translate(_SPELLINGS))
    letters = plain.encode("ascii", "ignore").decode()
    base = re.sub(r"[^A-Za-z0-9]+", "_", letters).strip("_")[:_LONGEST_ACCOUNT]
    if base and is_free(base):
        return base
    number = 2 if base else 1
    while not is_free(account := f"{base or _NUMBERED}{number}"):
        number += 1
    return account


def namespace_of(name: str) -> str:
    """Return the namespace of an account's own services: `/ada`, `/s_7` for `7`."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"/s_{word}" if word[0].isdigit() or word[0] == "_" else f"/{word}"


def account_of(student: str, accounts: set[str], written: dict[str, str]) -> str:
    """Return the account of a student; adds a new derived account to `written`."""
    for account, name in written.items():
        if name == student:
            return account
    if not account_name_problem(student) and student not in written:
        return student
    taken = {namespace_of(each) for each in {*accounts, *written}}
    account = account_for(student, lambda name: namespace_of(name) not in taken)
    written[account] = student
    return account


def refuse_shared_namespace(name: str, rows: dict[str, Row]) -> None:
    """Raise TaskRpcError if another account has the namespace of this name."""
    namespace = namespace_of(name)
    for other, row in rows.items():
        if other != name and not row.revoked and namespace_of(other) == namespace:
            raise TaskRpcError(
                f"the accounts {other} and {name} would share the namespace {namespace}:"
                f" give one of them another name, such as {_free_name(name, rows)}"
            )


def _free_name(name: str, rows: dict[str, Row]) -> str:
    taken = {namespace_of(each) for each in rows}
    return next(
        f"{name}{number}"
        for number in itertools.count(2)
        if namespace_of(f"{name}{number}") not in taken
    )
