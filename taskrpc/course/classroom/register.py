"""The register of a class: its accounts, and the addresses of its server."""

from __future__ import annotations

import contextlib
import ipaddress
import itertools
import re
import secrets
import socket
import unicodedata
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from taskrpc import Account
from taskrpc.course.classroom.authority import files_in
from taskrpc.course.classroom.invitation import Invitation, to_join_string
from taskrpc.errors import TaskRpcError
from taskrpc.spi import (
    AccountFile,
    Row,
    account_name_problem,
    file_locks,
    private_files,
    robot_namespace,
)

_SECRET_BYTES = 18


class Place(msgspec.Struct, frozen=True):
    """The addresses at which laptops reach the class's server."""

    hosts: tuple[str, ...]
    """Names or addresses, the most probable one first."""
    port: int
    domain: int = 0
    robots: int = 1
    """The students are distributed among so many robots."""

    @property
    def addresses(self) -> tuple[str, ...]:
        """`HOST:PORT`, with brackets around IPv6 addresses."""
        shown = (f"[{host}]" if ":" in host else host for host in self.hosts)
        return tuple(f"{host}:{self.port}" for host in shown)


class Register:
    """The files of a class in one folder, which is created if it is missing."""

    def __init__(self, folder: Path) -> None:
        self.folder = private_files.private_dir(folder)
        self.accounts_file = folder / "accounts.json"
        self.attendance_file = folder / "attendance.json"
        self.certificates = files_in(folder)
        self._place_file = folder / "place.json"
        self._names_file = folder / "names.json"

    def accounts(self) -> list[Account]:
        """All accounts, in the order in which they were added."""
        file = self._read()
        return [file.account(name) for name in file.rows]

    def add(self, names: Iterable[str], expires: float) -> list[Account]:
        """Add accounts for students until `expires` (seconds since 1970); returns them.

        A name that is not valid for an account, such as José, gets an account that is derived from
        it; the same name always gets the same account. An existing account keeps its secret and its
        role. A revoked account is replaced by a new one.

        Raises TaskRpcError, and adds no account, for an invalid name, or if two accounts would have
        the same namespace.
        """
        return self._replace(lambda _: False, names, expires)

    def renew(self, names: Iterable[str] | None, expires: float) -> list[Account]:
        """Give the students new secrets until `expires`, so that the earlier ones end.

        With `names`, these students replace all earlier ones. Accounts with another role than
        submit, such as an assistant's, stay as they are. A derived account is never given to
        another student: what is stored of its earlier student would be shown as the new one's.
        Raises TaskRpcError, and changes no account, as `add` does.
        """
        found = self._read().rows
        if names is None:
            known = self.names()
            students = ((name, row) for name, row in found.items() if row.role == "submit")
            names = [known.get(name, name) for name, row in students if not row.revoked]
        return self._replace(lambda row: row.role == "submit", names, expires)

    def _replace(
        self, is_former: Callable[[Row], bool], names: Iterable[str], expires: float
    ) -> list[Account]:
        """Remove the former accounts and add those of these students, all or nothing."""
        students = [cleaned(name) for name in names]
        for student in students:
            if problem := student_name_problem(student):
                raise TaskRpcError(problem)
        wanted: list[str] = []

        def change(rows: dict[str, Row]) -> None:
            for name in [name for name, row in rows.items() if is_former(row)]:
                del rows[name]
            written = self.names()
            for student in students:
                wanted.append(_account_of(student, {*rows, *wanted}, written))
            for name in wanted:
                old = rows.get(name)
                if old is None or old.revoked:
                    old = Row(secrets.token_urlsafe(_SECRET_BYTES))
                rows[name] = Row(old.secret, old.role, expires)
            for name in wanted:
                _check_namespace(name, rows)
            if written:
                private_files.write_private(self._names_file, msgspec.json.encode(written))

        self._edit(change)
        return [account for account in self.accounts() if account.name in wanted]

    def revoke(self, name: str) -> None:
        """Revoke an account, given its name or its student's name.

        Raises TaskRpcError if there is no such account.
        """

        def change(rows: dict[str, Row]) -> None:
            written = self.names()
            accounts = {student: account for account, student in written.items()}
            account = accounts.get(cleaned(name), name)
            if account not in rows:
                known = ", ".join(written.get(each, each) for each in rows) or "none"
                raise TaskRpcError(f"there is no account {name!r}; there are: {known}")
            rows[account].revoked = True

        self._edit(change)

    def names(self) -> dict[str, str]:
        """Return the students' names by account, for accounts with a derived name."""
        try:
            return msgspec.json.decode(self._names_file.read_bytes(), type=dict[str, str])
        except FileNotFoundError:
            return {}
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise TaskRpcError(f"{self._names_file}: {error}") from None

    @property
    def place(self) -> Place:
        """The server's addresses. Reading raises TaskRpcError before the first assignment."""
        try:
            return msgspec.json.decode(self._place_file.read_bytes(), type=Place)
        except FileNotFoundError:
            raise TaskRpcError("there is no class yet: `taskrpc classroom` makes one") from None
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise TaskRpcError(f"{self._place_file}: {error}") from None

    @place.setter
    def place(self, place: Place) -> None:
        private_files.write_private(self._place_file, msgspec.json.encode(place))

    @property
    def robots(self) -> int:
        """The number of the class's robots; 1 before there is a class."""
        return 1 if (place := self._known_place()) is None else place.robots

    @property
    def port(self) -> int | None:
        """The port of the class's server; None before there is a class."""
        return None if (place := self._known_place()) is None else place.port

    def _known_place(self) -> Place | None:
        try:
            return self.place
        except TaskRpcError:
            return None

    def robot_of(self, account: str) -> str:
        """Return the namespace of a student's robot: `/`, `/robot2` and so on, in turn."""
        names = [*self._read().rows]
        return robot_namespace(names.index(account) % self.place.robots + 1)

    def join_string(self, account: Account) -> str:
        """Return the join string of an account.

        Raises TaskRpcError if another account has the same namespace.
        """
        _check_namespace(account.name, self._read().rows)
        place = self.place
        return to_join_string(
            Invitation(
                place.addresses,
                self.certificates.fingerprint,
                account.token,
                self.robot_of(account.name).rstrip("/") + namespace_of(account.name),
                int(account.expires),
                place.domain,
            )
        )

    def _edit(self, change: Callable[[dict[str, Row]], None]) -> None:
        with file_locks.locked(self.folder / "lock"):
            rows = self._read().rows
            change(rows)
            content = msgspec.json.format(msgspec.json.encode({"accounts": rows}), indent=2)
            private_files.write_private(self.accounts_file, content + b"\n")

    def _read(self) -> AccountFile:
        try:
            content = self.accounts_file.read_bytes()
        except FileNotFoundError:
            content = b"{}"
        except OSError as error:
            raise TaskRpcError(f"{self.accounts_file}: {error.strerror}") from None
        return AccountFile(self.accounts_file, content)


def _account_of(student: str, accounts: set[str], written: dict[str, str]) -> str:
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


def _check_namespace(name: str, rows: dict[str, Row]) -> None:
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


def namespace_of(name: str) -> str:
    """Return the namespace of an account's own services: `/ada`, `/s_7` for `7`."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"/s_{word}" if word[0].isdigit() or word[0] == "_" else f"/{word}"


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


# The names and addresses of this machine

_HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?").fullmatch

# A UDP socket that connects to one of these gets the address from which this machine would send; no
# packet is sent. The first stands for the internet, the others for the ranges of private networks,
# which may have another route.
_ELSEWHERE = ("192.0.2.1", "192.168.255.254", "10.255.255.254", "172.31.255.254")


def own_addresses() -> list[str]:
    """Return this machine's IPv4 addresses, the most probable one first; may be empty."""
    found = [*_outgoing(), *_of_host_name()]
    return [each for each in dict.fromkeys(found) if _is_reachable(each)]


def own_names() -> list[str]:
    """Return the names of this machine for the certificate, in addition to `own_addresses`."""
    name = socket.gethostname()
    return [*([name] if is_host(name) else []), "localhost", "127.0.0.1", "::1"]


def is_host(text: str) -> bool:
    """Whether a text is an address, or a host name that certificates can contain; no port."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return bool(_HOST_NAME(text))
    return True


def _outgoing() -> list[str]:
    found = []
    for elsewhere in _ELSEWHERE:
        with (
            contextlib.suppress(OSError),
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe,
        ):
            probe.connect((elsewhere, 9))
            found.append(str(probe.getsockname()[0]))
    return found


def _of_host_name() -> list[str]:
    try:
        return socket.gethostbyname_ex(socket.gethostname())[2]
    except (OSError, UnicodeError):
        return []


def _is_reachable(address: str) -> bool:
    parsed = ipaddress.ip_address(address)
    return not (parsed.is_loopback or parsed.is_unspecified or parsed.is_link_local)
