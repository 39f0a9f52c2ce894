"""The accounts that a server goes by, also while their file changes."""

from __future__ import annotations

import logging
import os
import time
from codecs import BOM_UTF8
from datetime import datetime
from pathlib import Path
from typing import Literal

import msgspec
from msgspec.structs import replace

from taskrpc import platform
from taskrpc.errors import TaskRpcError
from taskrpc.security.roles import MIN_SECRET, Account, Accounts, Role

log = logging.getLogger("taskrpc.transport")

TELL_EVERY = 60.0
"""Seconds between two log lines about a file that cannot be used."""

_ONLY_TAKES_AWAY = "only the restrictions in this file of accounts take effect: "

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


class AccountSource:
    """The current accounts: given once, or read from a file again whenever it changes.

    Raises TaskRpcError for a file that is invalid, or that other users can read.
    """

    def __init__(self, given: Accounts | str | Path) -> None:
        self._path: Path | None = None
        self._seen: object = None
        self._problem = ""
        """Why the current file is not in force, and what is instead; "" if it is in force."""
        self._told = 0.0
        if isinstance(given, Accounts):
            self.current = given
        else:
            self._path = Path(given)
            self._seen = _signature(self._path)
            self.current = read_accounts(self._path)

    @property
    def may_change(self) -> bool:
        """Whether they come from a file, which must be checked for changes."""
        return self._path is not None

    def refresh(self) -> bool:
        """Check whether the file has changed; return whether the accounts have.

        While the file is invalid, the accounts of the last valid file stay in force, and the log
        repeats the reason. If other users can read the file but not write it, its restrictions
        take effect, such as a revocation.
        """
        if self._path is None:
            return False
        if (seen := _signature(self._path)) == self._seen:
            self._tell_problem(every=TELL_EVERY)
            return False
        self._seen, before = seen, self.current
        try:
            found, self._problem = _read(self._path)
        except TaskRpcError as error:
            self._problem = f"the accounts stay as they were: {error}"
        else:
            self.current = _narrowed(before, found) if self._problem else found
        self._tell_problem(every=0.0)
        if not self._problem:
            log.info("%s: %d accounts", self._path, len(self.current))
        return self.current is not before

    def _tell_problem(self, *, every: float) -> None:
        now = time.monotonic()
        if self._problem and now - self._told >= every:
            self._told = now
            log.error("%s", self._problem)


def read_accounts(path: Path) -> Accounts:
    """The accounts of a file: JSON where its name ends in .json, TOML otherwise.

    Raises TaskRpcError for a file that others can read or that has no accounts in this form.
    """
    found, problem = _read(path)
    if problem:
        raise TaskRpcError(problem.removeprefix(_ONLY_TAKES_AWAY))
    return found


def _read(path: Path) -> tuple[Accounts, str]:
    """The accounts of a file, and why only its restrictions take effect ("" if all of it does).

    Raises TaskRpcError for a file that is invalid or that other users can write.
    """
    try:
        with open(path, "rb") as file:
            problem = platform.why_not_private(file.fileno(), path)
            if problem and not platform.is_written_by_us_only(file.fileno()):
                raise TaskRpcError(problem)
            # Some editors begin a file with a byte order mark.
            content = file.read().removeprefix(BOM_UTF8)
    except OSError as error:
        raise TaskRpcError(f"{path}: {error.strerror}") from None
    return _parsed(path, content), f"{_ONLY_TAKES_AWAY}{problem}" if problem else ""


def _parsed(path: Path, content: bytes) -> Accounts:
    decode = msgspec.json.decode if path.suffix == ".json" else msgspec.toml.decode
    try:
        found = decode(content, type=_File)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        # The parser's text may quote the file, and so a secret, if the syntax is invalid.
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
    except (ValueError, OverflowError, OSError) as error:  # an instant that no clock can show
        raise TaskRpcError(f"{path}: expires: {error}") from None


def _narrowed(old: Accounts, new: Accounts) -> Accounts:
    """The old accounts, restricted to what the new ones still allow."""
    by_name = {account.name: account for account in new}
    return Accounts(_least(account, by_name.get(account.name)) for account in old)


def _least(old: Account, new: Account | None) -> Account:
    if new is None or new.secret != old.secret:
        return replace(old, revoked=True)
    expires = min((each for each in (old.expires, new.expires) if each), default=0.0)
    revoked = old.revoked or new.revoked
    return replace(old, role=min(old.role, new.role), expires=expires, revoked=revoked)


def _account(name: str, row: _Row) -> Account:
    expires = row.expires.timestamp() if isinstance(row.expires, datetime) else row.expires
    return Account(name, row.secret, Role[row.role.upper()], expires, row.revoked)


def _signature(path: Path) -> object:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode
