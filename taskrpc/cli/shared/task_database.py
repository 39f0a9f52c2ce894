"""The file in which a task server without `--db` keeps its tasks."""

from __future__ import annotations

from pathlib import Path

from taskrpc import platform
from taskrpc.transport.settings import domain_id


def default_database() -> Path:
    """Return the database of this user's task server in this domain."""
    domain = domain_id()
    name = f"tasks_domain_{domain}.db" if domain else "tasks.db"
    return platform.state_dir() / name
