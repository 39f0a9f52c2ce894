"""Roles, accounts, and the tokens with which users prove their accounts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from enum import IntEnum

import msgspec

from taskrpc.errors import TaskRpcError

MIN_SECRET = 16
"""The least number of characters of a secret that other machines can try to guess."""

# Python compiles these patterns at their first use: most programs have no accounts.
_NAME = r"[A-Za-z0-9_.@+-]{1,64}"
_SECRET = r"[A-Za-z0-9_~=+/-]{1,256}"
_TOKEN = rf"({_NAME})\.{_SECRET}".encode()


class Role(IntEnum):
    """What an account allows; each role includes the smaller ones."""

    OBSERVE = 1
    """Read: lists, states and changes."""
    SUBMIT = 2
    """Submit work, and cancel one's own."""
    OPERATE = 3
    """Cancel, pause and stop the work of others too."""
    ADMIN = 4
    """Everything."""


class Account(msgspec.Struct, frozen=True):
    """One user of a server.

    Raises TaskRpcError for a name or secret with characters that a token cannot have, and for an
    invalid `expires`.
    """

    name: str
    """Letters, digits and `_.@+-`, at most 64."""
    secret: str
    """Letters, digits and `_~=+/-`, drawn at random."""
    role: Role = Role.SUBMIT
    expires: float = 0.0
    """When the account expires, in seconds since 1970; 0.0: never."""
    revoked: bool = False

    def __post_init__(self) -> None:
        if problem := account_name_problem(self.name):
            raise TaskRpcError(problem)
        if not re.fullmatch(_SECRET, self.secret):
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
        # Without the secret, which must not appear in logs.
        return (
            f"Account(name={self.name!r}, role={self.role!r}, expires={self.expires!r},"
            f" revoked={self.revoked!r})"
        )

    @property
    def token(self) -> str:
        """The token of the account's user: `NAME.SECRET`."""
        return f"{self.name}.{self.secret}"

    def refusal(self, now: float) -> str:
        """Return why the account is refused at `now` (seconds since 1970), "" if it is not."""
        if self.revoked:
            return f"the account {self.name} is revoked"
        return f"the account {self.name} has expired" if 0 < self.expires <= now else ""


class Accounts:
    """The accounts of a server, by name. Raises TaskRpcError for two with one name."""

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
        """Return the account of this name if it is valid at `now` (seconds since 1970)."""
        account = self._by_name.get(name)
        return None if account is None or account.refusal(now) else account

    def refusal(self, name: str, now: float) -> str:
        """Return why `find` returns no account, for the server's log only; "" if it does."""
        account = self._by_name.get(name)
        return f"there is no account {name}" if account is None else account.refusal(now)

    def recheck(self, proved: Account, now: float) -> Account | str:
        """Return what an account is now that a caller has proved earlier.

        Returns a reason, for the server's log only, if the caller may not call any more: the
        account is gone, revoked or expired, or has another secret.
        """
        account = self.find(proved.name, now)
        if account is None:
            return self.refusal(proved.name, now)
        if account.secret != proved.secret:
            return f"{proved.name} has another secret now"
        return account


def account_name_problem(name: str) -> str:
    """Return why an account cannot have this name, "" if it can."""
    if re.fullmatch(_NAME, name):
        return ""
    return f"an account's name: expected 1 to 64 letters, digits or any of _.@+-, got {name!r}"


def account_of(token: bytes) -> str:
    """Return the name of the account in a token, "" for a secret without an account."""
    if b"." not in token:
        return ""
    found = re.fullmatch(_TOKEN, token)
    return "" if found is None else found[1].decode()
