"""The class's register: its accounts and where its server is, in a folder of the lecturer's."""

from __future__ import annotations

import itertools
import re
import secrets
import unicodedata
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

import msgspec

from taskrpc import platform
from taskrpc.classroom.authority import files_in
from taskrpc.classroom.invitation import Invitation, to_join_string
from taskrpc.errors import TaskRpcError
from taskrpc.security.roles import Account, Role, account_name_problem

_SECRET_BYTES = 18


class Place(msgspec.Struct, frozen=True):
    """Where laptops reach the class's server."""

    hosts: tuple[str, ...]
    """Names or addresses, the likeliest first."""
    port: int
    domain: int = 0

    @property
    def addresses(self) -> tuple[str, ...]:
        """`HOST:PORT`, with brackets where IPv6 wants them."""
        shown = (f"[{host}]" if ":" in host else host for host in self.hosts)
        return tuple(f"{host}:{self.port}" for host in shown)


class _Row(msgspec.Struct):
    secret: str
    role: Literal["observe", "submit", "operate", "admin"] = "submit"
    expires: float = 0.0
    revoked: bool = False

    def __repr__(self) -> str:
        return f"_Row({self.role})"  # without the secret: what is printed ends in logs


class _File(msgspec.Struct):
    accounts: dict[str, _Row] = {}


class Register:
    """The files of a class in one folder, which is made if need be."""

    def __init__(self, folder: Path) -> None:
        self.folder = platform.private_dir(folder)
        self.accounts_file = folder / "accounts.json"
        self.attendance_file = folder / "attendance.json"
        self.certificates = files_in(folder)
        self._place_file = folder / "place.json"
        self._names_file = folder / "names.json"

    def accounts(self) -> list[Account]:
        """All accounts, in the order in which they were added."""
        return [_account(name, row) for name, row in self._read().accounts.items()]

    def add(self, names: Iterable[str], expires: float) -> list[Account]:
        """Accounts for students of these names until `expires` (seconds since 1970).

        A name that no account can have, such as José, gets an account that is derived from it; the
        same name gets the same account again. Old ones keep their secret and their role. A revoked
        one may be used again, as if it were new.

        Raises TaskRpcError, and adds none, for what is no name, and where two accounts would have
        one namespace.
        """
        students = [cleaned(name) for name in names]
        for student in students:
            if problem := why_no_student(student):
                raise TaskRpcError(problem)
        wanted: list[str] = []

        def change(rows: dict[str, _Row]) -> None:
            written = self.names()
            for student in students:
                wanted.append(_account_of(student, {*rows, *wanted}, written))
            if written:
                platform.write_private(self._names_file, msgspec.json.encode(written))
            for name in wanted:
                old = rows.get(name)
                if old is None or old.revoked:
                    old = _Row(secrets.token_urlsafe(_SECRET_BYTES))
                row = _Row(old.secret, old.role, expires)
                rows[_account(name, row).name] = row
            for name in wanted:
                _check_namespace(name, rows)

        self._edit(change)
        return [account for account in self.accounts() if account.name in wanted]

    def revoke(self, name: str) -> None:
        """Refuse an account from now on, named by itself or by its student.

        Raises TaskRpcError if there is no such account.
        """

        def change(rows: dict[str, _Row]) -> None:
            written = self.names()
            accounts = {student: account for account, student in written.items()}
            account = accounts.get(cleaned(name), name)
            if account not in rows:
                known = ", ".join(written.get(each, each) for each in rows) or "none"
                raise TaskRpcError(f"there is no account {name!r}; there are: {known}")
            rows[account].revoked = True

        self._edit(change)

    def names(self) -> dict[str, str]:
        """The students' names as they were written, by account, where the two differ."""
        try:
            return msgspec.json.decode(self._names_file.read_bytes(), type=dict[str, str])
        except FileNotFoundError:
            return {}
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise TaskRpcError(f"{self._names_file}: {error}") from None

    @property
    def place(self) -> Place:
        """Where the server is. Raises TaskRpcError before `place` was set."""
        try:
            return msgspec.json.decode(self._place_file.read_bytes(), type=Place)
        except FileNotFoundError:
            raise TaskRpcError("there is no class yet: `taskrpc classroom` makes one") from None
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise TaskRpcError(f"{self._place_file}: {error}") from None

    @place.setter
    def place(self, place: Place) -> None:
        platform.write_private(self._place_file, msgspec.json.encode(place))

    def join_string(self, account: Account) -> str:
        """The line with which the laptop of this account joins.

        Raises TaskRpcError where another account has its namespace.
        """
        _check_namespace(account.name, self._read().accounts)
        place = self.place
        return to_join_string(
            Invitation(
                place.addresses,
                self.certificates.fingerprint,
                account.token,
                namespace_of(account.name),
                int(account.expires),
                place.domain,
            )
        )

    def _edit(self, change: Callable[[dict[str, _Row]], None]) -> None:
        with platform.locked(self.folder / "lock"):
            found = self._read()
            change(found.accounts)
            content = msgspec.json.format(msgspec.json.encode(found), indent=2)
            platform.write_private(self.accounts_file, content + b"\n")

    def _read(self) -> _File:
        try:
            return msgspec.json.decode(self.accounts_file.read_bytes(), type=_File)
        except FileNotFoundError:
            return _File()
        except OSError as error:
            raise TaskRpcError(f"{self.accounts_file}: {error.strerror}") from None
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise TaskRpcError(f"{self.accounts_file}: {error}") from None


def _account(name: str, row: _Row) -> Account:
    return Account(name, row.secret, Role[row.role.upper()], row.expires, row.revoked)


def _account_of(student: str, accounts: set[str], written: dict[str, str]) -> str:
    """The account of a student; a new account is derived from the name and added to `written`."""
    for account, name in written.items():
        if name == student:
            return account
    if not account_name_problem(student) and student not in written:
        return student
    taken = {namespace_of(each) for each in {*accounts, *written}}
    account = account_for(student, lambda name: namespace_of(name) not in taken)
    written[account] = student
    return account


def _check_namespace(name: str, rows: dict[str, _Row]) -> None:
    """Refuse a name whose namespace another account has; different names may give the same one."""
    namespace = namespace_of(name)
    for other, row in rows.items():
        if other != name and not row.revoked and namespace_of(other) == namespace:
            raise TaskRpcError(
                f"the accounts {other} and {name} would share the namespace {namespace}:"
                f" give one of them another name, such as {_free_name(name, rows)}"
            )


def _free_name(name: str, rows: dict[str, _Row]) -> str:
    taken = {namespace_of(each) for each in rows}
    return next(
        f"{name}{number}"
        for number in itertools.count(2)
        if namespace_of(f"{name}{number}") not in taken
    )


def namespace_of(name: str) -> str:
    """The namespace for services of an account's own: `/ada`, `/s_7` for `7`."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"/s_{word}" if word[0].isdigit() or word[0] == "_" else f"/{word}"


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
