"""Where files go: the folders for files of a run, of the user, and for downloads."""

from __future__ import annotations

import os
import sys

from taskrpc.core.system import private_files

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path


def runtime_dir() -> Path:
    """Return the folder for files that last as long as their process; creates it if necessary.

    Only this user can enter it. Raises TaskRpcError if others can, or own it.
    """
    return private_files.private_dir(runtime_path())


def runtime_path() -> Path:
    """Return the path of `runtime_dir`, without creating the folder."""
    from pathlib import Path

    if xdg := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(xdg) / "taskrpc"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or _temporary()) / "taskrpc" / "run"
    else:
        return Path(_temporary()) / f"taskrpc-{os.getuid()}"


def _temporary() -> str:
    if sys.platform == "win32":
        import tempfile

        return tempfile.gettempdir()
    else:  # importing tempfile would cost a server's start more than its sockets do
        return os.environ.get("TMPDIR") or "/tmp"


def state_dir() -> Path:
    """Return the folder for files that outlast their process; creates it if necessary.

    The task server's database is there. Only this user can enter the folder. Raises TaskRpcError
    if others can, or own it.
    """
    return private_files.private_dir(find_state_dir())


def find_state_dir() -> Path:
    """Return the path of `state_dir`, without creating the folder."""
    from pathlib import Path

    if xdg := os.environ.get("XDG_STATE_HOME"):
        return Path(xdg) / "taskrpc"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "taskrpc"
    elif sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "taskrpc"
    else:
        return Path.home() / ".local" / "state" / "taskrpc"


def cache_dir() -> Path:
    """Return the folder for files that can be downloaded again; creates it if necessary.

    Only this user can enter the folder. Raises TaskRpcError if others can, or own it.
    """
    return private_files.private_dir(_cache_path())


def _cache_path() -> Path:
    from pathlib import Path

    if xdg := os.environ.get("XDG_CACHE_HOME"):
        return Path(xdg) / "taskrpc"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or _temporary()) / "taskrpc" / "cache"
    elif sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "taskrpc"
    else:
        return Path.home() / ".cache" / "taskrpc"
