"""The register of a class: the accounts of its students."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from taskrpc import Account
from taskrpc.course.classroom.authority import files_in
from taskrpc.course.classroom.class_server import ClassServer, read_server, write_server
from taskrpc.course.classroom.invitation import Invitation, to_join_string
from taskrpc.course.classroom.student_names import (
    account_of,
    cleaned,
    namespace_of,
    refuse_shared_namespace,
    student_name_problem,
)
from taskrpc.errors import TaskRpcError
from taskrpc.spi import (
    AccountFile,
    Row,
    file_locks,
    private_files,
    robot_namespace,
)

_SECRET_BYTES = 18


class Register:
    """The files of a class in one folder, which is created if it is missing."""

    def __init__(self, folder: Path) -> None:
        self.folder = private_files.private_dir(folder)
        self.accounts_file = folder / "accounts.json"
        self.attendance_file = folder / "attendance.json"
        self.certificates = files_in(folder)
        self._server_file = folder / "server.json"
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
                wanted.append(account_of(student, {*rows, *wanted}, written))
            for name in wanted:
                old = rows.get(name)
                if old is None or old.revoked:
                    old = Row(secrets.token_urlsafe(_SECRET_BYTES))
                rows[name] = Row(old.secret, old.role, expires)
            for name in wanted:
                refuse_shared_namespace(name, rows)
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
    def server(self) -> ClassServer:
        """The class's server. Reading raises TaskRpcError before the first assignment."""
        return read_server(self._server_file)

    @server.setter
    def server(self, server: ClassServer) -> None:
        write_server(self._server_file, server)

    @property
    def robots(self) -> int:
        """The number of the class's robots; 1 before there is a class."""
        return 1 if (server := self._known_server()) is None else server.robots

    @property
    def port(self) -> int | None:
        """The port of the class's server; None before there is a class."""
        return None if (server := self._known_server()) is None else server.port

    def _known_server(self) -> ClassServer | None:
        try:
            return self.server
        except TaskRpcError:
            return None

    def robot_of(self, account: str) -> str:
        """Return the namespace of a student's robot: `/`, `/robot2` and so on, in turn."""
        names = [*self._read().rows]
        return robot_namespace(names.index(account) % self.server.robots + 1)

    def join_string(self, account: Account) -> str:
        """Return the join string of an account.

        Raises TaskRpcError if another account has the same namespace.
        """
        refuse_shared_namespace(account.name, self._read().rows)
        server = self.server
        return to_join_string(
            Invitation(
                server.addresses,
                self.certificates.fingerprint,
                account.token,
                self.robot_of(account.name).rstrip("/") + namespace_of(account.name),
                int(account.expires),
                server.domain,
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
