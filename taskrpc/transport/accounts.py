"""The accounts that a server goes by, also while their file changes."""

from __future__ import annotations

import logging
import os
from codecs import BOM_UTF8
from datetime import datetime
from pathlib import Path
from typing import Literal

import msgspec

from taskrpc import platform
from taskrpc.access import MIN_SECRET, Account, Accounts, Role
from taskrpc.errors import TaskRpcError

log = logging.getLogger("taskrpc.transport")

_RoleName = Literal["observe", "submit", "operate", "admin"]


class _Row(msgspec.Struct, forbid_unknown_fields=True):
    """One account as the file has it."""

    secret: str
    role: _RoleName = "submit"
    expires: float | datetime = 0.0
    revoked: bool = False

    def __repr__(self) -> str:
        return f"_Row({self.role})"  # without the secret: what is printed ends in logs


class _File(msgspec.Struct, forbid_unknown_fields=True):
    accounts: dict[str, _Row] = {}


class AccountBook:
    """Accounts as they are now: given once, or those of a file, read afresh when it changes."""

    def __init__(self, given: Accounts | str | Path) -> None:
        self._path: Path | None = None
        self._seen: object = None
        if isinstance(given, Accounts):
            self.now = given
        else:
            self._path = Path(given)
            self._seen = _signature(self._path)
            self.now = read_accounts(self._path)

    def look(self) -> bool:
        """Look whether the file has changed; returns whether the accounts did.

        One that cannot be read changes nothing but the log.
        """
        if self._path is None or (seen := _signature(self._path)) == self._seen:
            return False
        self._seen = seen
        try:
            self.now = read_accounts(self._path)
        except TaskRpcError as error:
            log.error("the accounts stay as they were: %s", error)
            return False
        log.info("%s: %d accounts", self._path, len(self.now))
        return True


def read_accounts(path: Path) -> Accounts:
    """The accounts of a file: JSON where its name ends in .json, TOML otherwise.

    Raises TaskRpcError for a file that others can read or that has no accounts in this form.
    """
    decode = msgspec.json.decode if path.suffix == ".json" else msgspec.toml.decode
    try:
        with open(path, "rb") as file:
            platform.check_private(file.fileno(), path)
            # Some editors put a mark before what they write.
            found = decode(file.read().removeprefix(BOM_UTF8), type=_File)
    except OSError as error:
        raise TaskRpcError(f"{path}: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        # What the parser says may have a piece of the file in it, though only where it is no file
        # of accounts.
        problem = str(error) if isinstance(error, msgspec.ValidationError) else "it cannot be read"
        raise TaskRpcError(f"{path}: expected accounts as TOML or JSON: {problem}") from None
    for name, row in found.accounts.items():
        if len(row.secret) < MIN_SECRET:
            raise TaskRpcError(
                f"{path}: the secret of the account {name} has {len(row.secret)} characters;"
                f" expected at least {MIN_SECRET}"
            )
    try:
        return Accounts(_account(name, row) for name, row in found.accounts.items())
    except TaskRpcError as error:
        raise TaskRpcError(f"{path}: {error}") from None
    except (ValueError, OverflowError) as error:  # an instant that no clock can show
        raise TaskRpcError(f"{path}: expires: {error}") from None


def _account(name: str, row: _Row) -> Account:
    expires = row.expires.timestamp() if isinstance(row.expires, datetime) else row.expires
    return Account(name, row.secret, Role[row.role.upper()], expires, row.revoked)


def _signature(path: Path) -> object:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode
