"""The text of a file of accounts: what each row says, and in which line a mistake is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import msgspec

from taskrpc.core.security.roles import Account, Role
from taskrpc.errors import TaskRpcError

_RoleName = Literal["observe", "submit", "operate", "admin"]


class Row(msgspec.Struct):
    """One account, as it stands in the file."""

    secret: str
    role: _RoleName = "submit"
    expires: float | datetime = 0.0
    revoked: bool = False

    def __repr__(self) -> str:
        return f"Row({self.role})"  # without the secret, which must not appear in logs


_EXPECTED: Mapping[str, str] = {
    "secret": "a text in quotes",
    "role": "observe, submit, operate or admin",
    "expires": "seconds since 1970, or an instant such as 2026-12-24T18:00:00Z",
    "revoked": "true or false",
}
"""The fields of an account, and what each one expects."""
_FIELDS = "secret, role, expires and revoked"


class AccountFile:
    """The content of a file: JSON if its name ends in .json, TOML otherwise.

    Raises TaskRpcError for a content that is not accounts. No message quotes a secret.
    """

    def __init__(self, path: Path, content: bytes) -> None:
        self._path = path
        self._is_json = path.suffix == ".json"
        self._text = content.decode("utf-8", "replace")
        self.rows = {name: self._row(name, value) for name, value in self._tables(content).items()}
        """The accounts, by name."""

    def account(self, name: str) -> Account:
        """Return one account. Raises TaskRpcError for a name or value that none can have."""
        row = self.rows[name]
        try:
            expires = row.expires.timestamp() if isinstance(row.expires, datetime) else row.expires
            return Account(name, row.secret, Role[row.role.upper()], expires, row.revoked)
        except TaskRpcError as error:
            raise TaskRpcError(f"{self.where(name)}: {error}") from None
        except (ValueError, OverflowError, OSError) as error:  # outside a clock's range
            raise self._wrong(name, "expires", f"expires: {error}") from None

    def where(self, name: str, field: str = "") -> str:
        """Return the file, and the line of an account or of its field if it is found."""
        line = _line(self._text, name, field, is_json=self._is_json)
        return f"{self._path}, line {line}" if line else str(self._path)

    def _tables(self, content: bytes) -> dict[str, Any]:
        """Return the account's tables by name, still unchecked."""
        try:
            found = (msgspec.json if self._is_json else msgspec.toml).decode(content)
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            raise self._unreadable(str(error)) from None
        if not isinstance(found, dict):
            raise self._not_accounts(f"got {_kind(found)}")
        if unknown := [name for name in found if name != "accounts"]:
            raise self._not_accounts(f"got {unknown[0][:64]!r} beside them")
        accounts = found.get("accounts", {})
        if not isinstance(accounts, dict):
            raise self._not_accounts(f"accounts is {_kind(accounts)}")
        return accounts

    def _unreadable(self, reason: str) -> TaskRpcError:
        # The parser's text may quote a line of the file with a secret. Only its place is told.
        line = 0
        if found := re.search(r"\(at line (\d+)", reason):
            line = int(found[1])
        elif found := re.search(r"\(byte (\d+)\)", reason):
            line = self._text.count("\n", 0, int(found[1])) + 1
        where = f"{self._path}, line {line}" if line else str(self._path)
        form = "JSON" if self._is_json else "TOML, or JSON in a file whose name ends in .json"
        return TaskRpcError(f"{where}: expected accounts as {form}: it cannot be read")

    def _not_accounts(self, got: str) -> TaskRpcError:
        such = '{"accounts": {"ana": {…}}}' if self._is_json else "[accounts.ana]"
        return TaskRpcError(f"{self._path}: expected only accounts, such as {such}; {got}")

    def _row(self, name: str, value: Any) -> Row:
        if not isinstance(value, dict):
            raise self._wrong(name, "", f"expected a table with {_FIELDS}, got {_kind(value)}")
        if unknown := [field for field in value if field not in _EXPECTED]:
            field = unknown[0]
            raise self._wrong(name, field, f"expected {_FIELDS}, got {field[:64]!r}")
        if "secret" not in value:
            raise self._wrong(name, "", "secret is missing")
        try:
            return msgspec.convert(value, Row)
        except msgspec.ValidationError as error:
            field = next(each for each in value if f"`$.{each}`" in str(error))
            found = value[field]
            got = repr(found)[:80] if isinstance(found, str) else str(found)[:80]
            got = _kind(found) if field == "secret" else got
            problem = f"{field}: expected {_EXPECTED[field]}, got {got}"
            raise self._wrong(name, field, problem) from None

    def _wrong(self, name: str, field: str, problem: str) -> TaskRpcError:
        return TaskRpcError(f"{self.where(name, field)}: the account {name[:64]}: {problem}")


def _kind(value: object) -> str:
    """Name the kind of a value in the words of the file's reader; never its content."""
    kinds = {dict: "a table", list: "a list", str: "a text", bool: "true or false"}
    return kinds.get(type(value), "a number" if isinstance(value, int | float) else "nothing")


def _line(text: str, name: str, field: str, *, is_json: bool) -> int:
    """Return the line of an account, or of its field; 0 if it is written in another way."""
    account, key = re.escape(name), re.escape(field)
    if is_json:
        begin = rf'(?P<key>"{account}")\s*:\s*\{{'
        wanted, end = rf'(?P<key>"{key}")\s*:', r"\}"
    else:
        begin = rf"^[ \t]*(?P<key>\[)\s*accounts\s*\.\s*([\"']?){account}\2\s*\]"
        wanted, end = rf"^[ \t]*([\"']?)(?P<key>{key})\1\s*=", r"^[ \t]*\["
    if (found := re.search(begin, text, re.MULTILINE)) is None:
        return 0
    rest = re.compile(end, re.MULTILINE).search(text, found.end())
    until = rest.start() if rest else len(text)
    inside = re.compile(wanted, re.MULTILINE).search(text, found.end(), until) if field else None
    return text.count("\n", 0, (inside or found).start("key")) + 1
