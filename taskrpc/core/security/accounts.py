"""The accounts of a server; a file of accounts is read again when it changes."""

from __future__ import annotations

import logging
import os
import time
from codecs import BOM_UTF8
from pathlib import Path

from msgspec.structs import replace

from taskrpc.core.security.account_file import AccountFile
from taskrpc.core.security.roles import MIN_SECRET, Account, Accounts
from taskrpc.core.system import private_files
from taskrpc.errors import TaskRpcError

log = logging.getLogger("taskrpc.transport")

LOG_PERIOD = 60.0
"""Seconds between two log lines about a file that cannot be used."""

_ONLY_RESTRICTS = "only the restrictions in this file of accounts take effect: "


class AccountSource:
    """The accounts that are in force now: fixed ones, or those of a file that may change.

    Raises TaskRpcError for a file that is invalid, or that other users can read.
    """

    def __init__(self, given: Accounts | str | Path) -> None:
        self._path: Path | None = None
        """The file; None for fixed accounts."""
        self._seen: object = None
        """The signature of the file that was read last."""
        self._problem = ""
        """Why the current file is not in force, and what is instead; "" if it is in force."""
        self._logged_at = 0.0
        """When the problem was last logged, on the monotonic clock."""
        if isinstance(given, Accounts):
            self.current = given
            """The accounts in force."""
        else:
            self._path = Path(given)
            self._seen = _signature(self._path)
            self.current = read_accounts(self._path)

    @property
    def can_change(self) -> bool:
        """Whether the accounts come from a file, which must be checked for changes."""
        return self._path is not None

    def refresh(self) -> bool:
        """Read the file again if it has changed; return whether the accounts have changed.

        While the file is invalid, the accounts of the last valid file stay in force, and the log
        repeats the reason. If other users can read the file but not write it, its restrictions
        take effect, such as a revocation.
        """
        if self._path is None:
            return False
        if (seen := _signature(self._path)) == self._seen:
            self._log_problem(period=LOG_PERIOD)
            return False
        self._seen, before = seen, self.current
        try:
            found, self._problem = _read(self._path)
        except TaskRpcError as error:
            self._problem = f"the accounts stay as they were: {error}"
        else:
            self.current = _narrowed(before, found) if self._problem else found
        self._log_problem(period=0.0)
        if not self._problem:
            log.info("%s: %d accounts", self._path, len(self.current))
        return self.current is not before

    def _log_problem(self, *, period: float) -> None:
        now = time.monotonic()
        if self._problem and now - self._logged_at >= period:
            self._logged_at = now
            log.error("%s", self._problem)


def read_accounts(path: Path) -> Accounts:
    """Return the accounts of a file: JSON if its name ends in .json, TOML otherwise.

    Raises TaskRpcError for a file that is invalid, or that other users can read.
    """
    found, problem = _read(path)
    if problem:
        raise TaskRpcError(problem.removeprefix(_ONLY_RESTRICTS))
    return found


def _read(path: Path) -> tuple[Accounts, str]:
    """Return the accounts of a file, and why only its restrictions take effect ("": all does).

    Raises TaskRpcError for a file that is invalid or that other users can write.
    """
    try:
        with open(path, "rb") as file:
            problem = private_files.why_not_private(file.fileno(), path)
            if problem and not private_files.is_written_by_us_only(file.fileno()):
                raise TaskRpcError(problem)
            # Some editors begin a file with a byte order mark.
            content = file.read().removeprefix(BOM_UTF8)
    except OSError as error:
        raise TaskRpcError(f"{path}: {error.strerror}") from None
    return _parsed(path, content), f"{_ONLY_RESTRICTS}{problem}" if problem else ""


def _parsed(path: Path, content: bytes) -> Accounts:
    file = AccountFile(path, content)
    for name, row in file.rows.items():
        if len(row.secret) < MIN_SECRET:
            raise TaskRpcError(
                f"{file.where(name, 'secret')}: the secret of the account {name} has"
                f" {len(row.secret)} characters; expected at least {MIN_SECRET}"
            )
    return Accounts(file.account(name) for name in file.rows)


def _narrowed(old: Accounts, new: Accounts) -> Accounts:
    """Return the old accounts, restricted to what the new ones still allow."""
    by_name = {account.name: account for account in new}
    return Accounts(_least(account, by_name.get(account.name)) for account in old)


def _least(old: Account, new: Account | None) -> Account:
    if new is None or new.secret != old.secret:
        return replace(old, revoked=True)
    expires = min((each for each in (old.expires, new.expires) if each), default=0.0)
    revoked = old.revoked or new.revoked
    return replace(old, role=min(old.role, new.role), expires=expires, revoked=revoked)


def _signature(path: Path) -> object:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode
