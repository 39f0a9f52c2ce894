"""Checks a database's path before the file is locked, created or opened.

Each check prevents a silent loss: two servers that use one file, a file that another user has
prepared, or a new, empty database in the place of one whose requests were acknowledged.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

from taskrpc.core.storage.lock import Lock
from taskrpc.core.system import private_files
from taskrpc.errors import StoreError

SIDE_FILES = ("", "-wal", "-shm")
"""The suffixes of the database's name for the files that SQLite keeps open."""
_READ_AT_START = (*SIDE_FILES, "-journal", ".lock")


def refuse_second_name(path: Path) -> None:
    """Refuse a file with a second hard link: each name would have its own lock file.

    Raises StoreError.
    """
    with contextlib.suppress(FileNotFoundError):
        found = os.stat(path)
        if stat.S_ISREG(found.st_mode) and found.st_nlink > 1:
            command = "fsutil hardlink list" if sys.platform == "win32" else "find / -samefile"
            raise StoreError(
                f"{path} has {found.st_nlink} names (hard links), so another server could use it"
                " under another name at the same time; remove the other name (find it with"
                f" `{command} {path}`), or copy the file instead of linking it"
            )


def refuse_strangers(path: Path) -> None:
    """Refuse symbolic links and other users' files in folders where every user may write.

    Raises StoreError.
    """
    for each in (*reversed(path.parents), path):
        if each.is_symlink() and private_files.is_writable_by_all(each.parent):
            raise StoreError(
                f"{each} is a symbolic link in a folder where every user may write, so another"
                " user may have made it; give the path of the file itself, in a folder of your own"
            )
    real = path.resolve()
    if not private_files.is_writable_by_all(real.parent):
        return
    for each in _side_files(real, _READ_AT_START):
        with contextlib.suppress(FileNotFoundError):
            if each.is_symlink() or not private_files.is_ours_or_roots(each.lstat()):
                raise StoreError(
                    f"{each} belongs to another user, in a folder where every user may write;"
                    " use a database in a folder of your own"
                )


def refuse_lost_store(path: Path, lock: Lock) -> None:
    """Refuse a missing or empty file if its lock or log shows that it may have had transactions.

    SQLite would delete the log of such a file, and the server would run repeated requests again.
    Raises StoreError.
    """
    if not path.exists():
        problem = "is missing"
    elif path.is_file() and not path.stat().st_size:
        problem = "is empty"
    else:
        return
    log = path.with_name(f"{path.name}-wal")
    if lock.may_have_commits or (log.exists() and log.stat().st_size):
        raise StoreError(lost_store(path, lock, problem))


def lost_store(path: Path, lock: Lock, problem: str) -> str:
    """Return the text for a file without tables that may have had transactions."""
    log = path.with_name(f"{path.name}-wal")
    count = lock.commit_count.commits if lock.commit_count is not None else 0
    there = [*([lock.path] if lock.may_have_commits else []), *([log] if log.exists() else [])]
    names = " and ".join(
        f"{each.name} (damaged)" if each == lock.path and lock.is_damaged else each.name
        for each in there
    )
    verb = "may belong" if lock.is_damaged else f"belong{'s'[: len(there) == 1]}"
    known = f" of {count} transaction{'s'[: count > 1]}" if count else ""
    return (
        f"{path} {problem}, but {names} beside it {verb} to a database{known}; restore that"
        f" database as {path.name}, or, to start with an empty one, remove"
        f" {' and '.join(str(each) for each in there)}"
    )


def _side_files(path: Path, endings: tuple[str, ...]) -> Iterator[Path]:
    return (path.with_name(path.name + ending) for ending in endings)
