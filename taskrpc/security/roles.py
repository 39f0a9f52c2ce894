"""Who may do what: roles, accounts, and the token that a user of an account holds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from enum import IntEnum

import msgspec

from taskrpc.errors import TaskRpcError

MIN_SECRET = 16
"""Characters that a secret must have where other machines can try to guess it."""

_NAME = r"[A-Za-z0-9_.@+-]{1,64}"
_IS_NAME = re.compile(_NAME).fullmatch
_IS_SECRET = re.compile(r"[A-Za-z0-9_~=+/-]{1,256}").fullmatch
_IS_TOKEN = re.compile(rf"({_NAME})\.[A-Za-z0-9_~=+/-]{{1,256}}".encode()).fullmatch


class Role(IntEnum):
    """What somebody may do; each role may also do what the smaller ones may."""

    OBSERVE = 1
    """Look: listings, states, what changes."""
    SUBMIT = 2
    """Give work, and call off one's own."""
    OPERATE = 3
    """Steer what others gave too: cancel, pause, stop."""
    ADMIN = 4
    """Everything."""


class Account(msgspec.Struct, frozen=True):
    """One user of a server.

    Raises TaskRpcError for a name or secret of other characters than a token can have, and for an
    end that is none.
    """

    name: str
    """Letters, digits and `_.@+-`, at most 64."""
    secret: str
    """Letters, digits and `_~=+/-`, drawn at random."""
    role: Role = Role.SUBMIT
    expires: float = 0.0
    """Seconds since 1970 from when on it is refused, 0.0 for never."""
    revoked: bool = False

    def __post_init__(self) -> None:
        if problem := why_no_name(self.name):
            raise TaskRpcError(problem)
        if not _IS_SECRET(self.secret):
            raise TaskRpcError(
                f"the secret of the account {self.name}: expected 1 to 256 letters, digits or any"
                " of _~=+/-"
            )
        if not 0 <= self.expires < math.inf:  # a file may say "nan", or a day before 1970
            raise TaskRpcError(
                f"the account {self.name}: expires: expected an instant after 1970, or 0 for never,"
                f" got {self.expires}"
            )

    def __repr__(self) -> str:
        # Without the secret: what is printed ends in logs.
        return (
            f"Account(name={self.name!r}, role={self.role!r}, expires={self.expires!r},"
            f" revoked={self.revoked!r})"
        )

    @property
    def token(self) -> str:
        """What the account's user gives as a token: `NAME.SECRET`."""
        return f"{self.name}.{self.secret}"

    def refusal(self, now: float) -> str:
        """Why the account is refused at an instant in seconds since 1970; "" where it is not."""
        if self.revoked:
            return f"the account {self.name} is revoked"
        return f"the account {self.name} has expired" if 0 < self.expires <= now else ""


class Accounts:
    """The accounts of a server, by their names. Raises TaskRpcError for two of one name."""

    def __init__(self, accounts: Iterable[Account] = ()) -> None:
        self._by_name: dict[str, Account] = {}
        for account in accounts:
            if account.name in self._by_name:
                raise TaskRpcError(f"the account {account.name} is given twice")
            self._by_name[account.name] = account

    def __iter__(self) -> Iterator[Account]:
        return iter(self._by_name.values())

    def __len__(self) -> int:
        return len(self._by_name)

    def find(self, name: str, now: float) -> Account | None:
        """The account of this name if it may be used at an instant in seconds since 1970."""
        account = self._by_name.get(name)
        return None if account is None or account.refusal(now) else account

    def refusal(self, name: str, now: float) -> str:
        """Why `find` gives no account, for the server's log only; "" where it gives one."""
        account = self._by_name.get(name)
        return f"there is no account {name}" if account is None else account.refusal(now)


def why_no_name(name: str) -> str:
    """Why an account cannot have this name, "" where it can."""
    if _IS_NAME(name):
        return ""
    return f"an account's name: expected 1 to 64 letters, digits or any of _.@+-, got {name!r}"


def account_of(token: bytes) -> str:
    """The account that a token names, "" for a bare secret."""
    found = _IS_TOKEN(token)
    return "" if found is None else found[1].decode()
