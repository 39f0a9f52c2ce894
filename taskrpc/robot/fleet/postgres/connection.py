"""Connections to PostgreSQL: settings, time limits, and errors as sentences for operators."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import socket
import sys
from collections.abc import Awaitable, Mapping
from typing import Any, TypeAlias, TypeVar

from taskrpc.errors import StoreError, TaskRpcError
from taskrpc.spi import install_command

try:
    import psycopg
    from psycopg import conninfo
except ImportError as error:
    command = install_command("postgres", "psycopg[binary]")
    raise TaskRpcError(f"--db postgresql://… needs psycopg ({error}): {command}") from None

T = TypeVar("T")

Connection: TypeAlias = "psycopg.AsyncConnection[Any]"

FAILURES = (psycopg.Error, OSError)
"""What work on a connection may raise."""

CONNECT_TIMEOUT = 5
"""Seconds to wait for a new connection."""
ANSWER_TIMEOUT = 8.0
"""Seconds to wait for the result of a transaction; then its connection counts as lost."""

_SETTINGS = {
    "connect_timeout": CONNECT_TIMEOUT,
    # A peer that is gone without a word is noticed within seconds.
    "keepalives_idle": 3,
    "keepalives_interval": 2,
    "keepalives_count": 3,
    "tcp_user_timeout": 8000,
}
# A process that is paused in the middle of a transaction must not hold the fleet's lock. The
# parameters that the operator gives in the URL take precedence.
_SESSION = (
    "SET idle_in_transaction_session_timeout = '3s'; SET lock_timeout = '6s';"
    " SET statement_timeout = '8s'; SET synchronous_commit = on"
)


def is_url(text: str) -> bool:
    """Return whether `--db` names a PostgreSQL database."""
    return text.startswith(("postgresql://", "postgres://"))


class DatabaseUrl:
    """Where a database is. Its texts never contain the password.

    Raises:
        TaskRpcError: it is not a valid URL.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        _check_credentials(url)
        try:
            parts = conninfo.conninfo_to_dict(url)
        except psycopg.Error as error:
            example = "postgresql://USER:PASSWORD@HOST:5432/DATABASE"
            reason = _without(url, str(error))
            raise TaskRpcError(f"--db: expected a URL such as {example}: {reason}") from None
        own = {name: str(value) for name, value in parts.items() if value}
        used = {**_defaults(own.get("service", "")), **own}
        if "host" in own:  # an address from elsewhere would be that of another host
            used["hostaddr"] = own.get("hostaddr", "")
        self._has_password = "password" in own
        self._password = used.get("password", "")
        self.shown = _shown(used)
        """Where connections go, by the URL, the environment and the service file; no password."""

    def __str__(self) -> str:
        return self.shown

    @property
    def has_password(self) -> bool:
        """Whether the URL itself contains a password."""
        return self._has_password

    async def connect(self, name: str) -> Connection:
        """Return a new connection with this application name. Raises StoreError."""
        _check_loop()
        own = conninfo.conninfo_to_dict(self._url)  # takes precedence
        settings: dict[str, Any] = {**_SETTINGS, **own, "application_name": name}
        try:
            connection: Connection = await psycopg.AsyncConnection.connect(
                conninfo.make_conninfo(**settings), autocommit=True
            )
        except psycopg.Error as error:
            raise self.error("cannot be used", error) from None
        try:
            await connection.execute(_SESSION)
        except psycopg.Error as error:
            await close(connection)
            raise self.error("cannot be used", error) from None
        except BaseException:
            await close(connection)
            raise
        return connection

    def error(self, problem: str, error: BaseException) -> StoreError:
        """Return an error with this database's name and the reason that PostgreSQL gives."""
        # Without the place in our statement, which says nothing to an operator.
        text = getattr(getattr(error, "diag", None), "message_primary", None) or str(error)
        text = re.sub(r"\s*Is the server running[^?]*\?", "", text)
        reason = self.without_password(" ".join(text.split()))
        found = StoreError(f"{self.shown} {problem}: {reason}{_hint(reason)}")
        found.for_callers = "the database of the fleet cannot be used; nothing was stored"
        return found

    def without_password(self, text: str) -> str:
        """Return a text without the password."""
        return text.replace(self._password, "***") if self._password else text


def _defaults(service: str) -> dict[str, str]:
    """Return libpq's defaults, by its environment variables and the section of its service file.

    libpq itself reads both, so that no rule of theirs is repeated here.
    """
    before = os.environ.get("PGSERVICE")
    try:
        if service:
            os.environ["PGSERVICE"] = service
        options = psycopg.pq.Conninfo.get_defaults()
    finally:
        if service:
            os.environ.pop("PGSERVICE")
            if before is not None:
                os.environ["PGSERVICE"] = before
    return {option.keyword.decode(): option.val.decode() for option in options if option.val}


def _shown(used: Mapping[str, str]) -> str:
    user = f"{used['user']}@" if used.get("user") else ""
    database = used.get("dbname") or used.get("user") or ""
    hosts = (used.get("host") or used.get("hostaddr") or "").split(",")
    ports = (used.get("port") or "5432").split(",")
    ports *= len(hosts) if len(ports) == 1 else 1
    if hosts[0].startswith(("/", "@")) or not hosts[0]:  # a Unix socket, not a machine
        folder = f" in {hosts[0]}" if hosts[0] else ""
        return f"postgresql://{user}/{database} at the local socket{folder}, port {ports[0]},"
    addresses = ",".join(f"{host}:{port}" for host, port in zip(hosts, ports, strict=False))
    return f"postgresql://{user}{addresses}/{database}"


def _check_credentials(url: str) -> None:
    """Refuse an unquoted / or @ in the password.

    libpq would take a part of the password for the host or the database, and errors would show it.
    """
    text = url.partition("://")[2]
    user, at, rest = text.partition("@")
    if at and "/" not in user:
        text = rest
    if "@" in text.partition("?")[0]:
        raise TaskRpcError(
            "--db: expected postgresql://USER@HOST:5432/DATABASE, got more than one @ or a / before"
            " it; put the password into PGPASSWORD, or write / as %2F and @ as %40 in it"
        )


def _without(url: str, text: str) -> str:
    """Return an error's text without any part of a URL that could be a password."""
    credentials = url.partition("://")[2].rpartition("@")[0]
    for secret in (url, credentials, credentials.partition(":")[2]):
        if secret:
            text = text.replace(secret, "***")
    return text.strip()


_HINTS = (
    (
        r"onnection refused|No such file",
        "start PostgreSQL there, or correct the host and the port in --db",
    ),
    (r"password", "correct the user and the password in --db, or set PGPASSWORD"),
    (r"database.*does not exist", "create it with: createdb --owner USER DATABASE"),
    (
        r'relation "taskrpc_',
        "the tables were deleted while this server ran: restore a backup, or start the server"
        " again to begin without tasks",
    ),
    (r"permission denied for schema", "give this user the right to create tables there"),
    (r"permission denied|must be owner", "let the servers use the user that created the tables"),
    (r"no pg_hba.conf entry", "allow this user and this machine in PostgreSQL's pg_hba.conf"),
    (r"does not support SSL", "set ssl = on in PostgreSQL, or another sslmode in --db"),
    (r"invalid (integer value|port)", "correct the port in --db"),
    (r"resolve|not known", "correct the host in --db"),
    (r"definition of service", "correct the service in --db or PGSERVICE"),
    (r"statement pooling", "set pool_mode = session in PgBouncer, or connect to PostgreSQL itself"),
    (r"No space left|could not extend", "free space on the disk of PostgreSQL"),
    (r"read-only transaction", "connect to the primary: add ?target_session_attrs=read-write"),
)


def _hint(reason: str) -> str:
    for pattern, advice in _HINTS:
        if re.search(pattern, reason):
            return f"; {advice}"
    return ""


def _check_loop() -> None:
    if sys.platform == "win32" and isinstance(
        asyncio.get_running_loop(), asyncio.ProactorEventLoop
    ):
        raise StoreError(
            "PostgreSQL cannot be used on Windows' ProactorEventLoop: run taskrpc-server on Linux"
            " or macOS, or a program of your own with"
            " asyncio.Runner(loop_factory=asyncio.SelectorEventLoop)"
        )


def is_lost(connection: Connection, error: BaseException) -> bool:
    """Return whether an error means that the connection is gone, not that a statement is wrong.

    PostgreSQL may report the end of a session, FATAL, after it has committed. Only an ERROR
    belongs to a statement, and proves that no later statement of the transaction ran.
    """
    if connection.closed or connection.broken or isinstance(error, OSError):
        return True
    severity = getattr(getattr(error, "diag", None), "severity_nonlocalized", None)
    return isinstance(error, psycopg.OperationalError) and severity != "ERROR"


async def check_pooling(url: DatabaseUrl) -> None:
    """Refuse a pool that gives each transaction another session, such as PgBouncer can do.

    There, LISTEN and the settings of the session would silently not work. Raises StoreError.
    """
    first = await url.connect("taskrpc pooling")
    second = None
    try:
        session = await answered(first, _session(first))
        if session == first.info.backend_pid:
            return  # a pool tells its clients other numbers than PostgreSQL does
        second = await url.connect("taskrpc pooling")
        await answered(second, second.execute("BEGIN"))
        others = await answered(second, _session(second))
        if others == session or await answered(first, _session(first)) != session:
            raise StoreError(
                f"{url}: expected a connection of its own, got a connection pool in transaction"
                " mode, in which LISTEN does not work; set pool_mode = session in PgBouncer, or"
                " connect to PostgreSQL itself"
            )
    except FAILURES as error:
        raise url.error("cannot be used", error) from error
    finally:
        await close(second)
        await close(first)


async def _session(connection: Connection) -> int:
    """Return the number of the PostgreSQL process that serves a connection at present."""
    row = await (await connection.execute("SELECT pg_backend_pid()")).fetchone()
    assert row is not None, "the statement has one row"
    return int(row[0])


async def answered(connection: Connection, work: Awaitable[T]) -> T:
    """Wait for work on a connection; after `ANSWER_TIMEOUT` the connection is cut.

    Raises what the work raises.
    """
    # To cancel the work would send a cancel request and wait for its result: on a network that
    # drops everything that never ends. A socket that is shut down ends the work at once.
    running = asyncio.ensure_future(work)
    try:
        done, _ = await asyncio.wait({running}, timeout=ANSWER_TIMEOUT)
    except asyncio.CancelledError:
        cut(connection)
        with contextlib.suppress(Exception):
            await running
        raise
    if not done:
        cut(connection)
    return await running


def cut(connection: Connection) -> None:
    """Shut a connection's socket down, without a word to the database."""
    with contextlib.suppress(OSError, psycopg.Error):
        made = socket.socket(fileno=connection.fileno())
        try:
            made.shutdown(socket.SHUT_RDWR)
        finally:
            made.detach()


async def close(connection: Connection | None) -> None:
    """Close a connection, whatever its state."""
    if connection is not None:
        with contextlib.suppress(Exception):
            await connection.close()
