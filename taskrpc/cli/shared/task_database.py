"""The file in which a task server without `--db` keeps its tasks."""

from __future__ import annotations

from pathlib import Path

from taskrpc.cli.shared.robots import suffix_of
from taskrpc.spi import domain_id, folders


def default_database(namespace: str = "/") -> Path:
    """Return the database of this user's task server in this domain, for one robot."""
    domain = domain_id()
    name = f"tasks_domain_{domain}" if domain else "tasks"
    return folders.state_dir() / f"{name}{suffix_of(namespace)}.db"
