"""The database of a task server: the file without `--db`, and what `--db` names."""

from __future__ import annotations

import re
from pathlib import Path

from taskrpc.cli.shared.robots import suffix_of
from taskrpc.spi import domain_id, folders

_PREFIXES = "postgresql://", "postgres://"
# Also what a mistyped URL begins with: it may contain a password, so it must not become a file.
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/|postgres(ql)?(:|//)", re.ASCII | re.IGNORECASE)


def default_database(namespace: str = "/") -> Path:
    """Return the database of this user's task server in this domain, for one robot."""
    domain = domain_id()
    name = f"tasks_domain_{domain}" if domain else "tasks"
    return folders.state_dir() / f"{name}{suffix_of(namespace)}.db"


def is_shared(database: str) -> bool:
    """Return whether `--db` names a database that the servers of a fleet share."""
    return database.startswith(_PREFIXES)


def mistyped(database: str) -> str:
    """Return what is wrong with a `--db` that looks like a URL but is none, "" if nothing is."""
    if is_shared(database) or not _SCHEME.match(database):
        return ""
    scheme, sign = re.split("([:/])", database)[:2]
    found = f"{scheme}{sign}…"  # not the rest: it may contain a password
    return f"--db: expected a file, :memory: or postgresql://…, got {found}"
