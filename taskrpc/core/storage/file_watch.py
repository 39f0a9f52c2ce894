"""Watches the files of an open database: another program may remove, replace or change them.

SQLite notices none of this. It writes to the file that it has opened, and to the log, which is
worth nothing without the file that belongs to it.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NamedTuple


class _State(NamedTuple):
    """A file at one moment."""

    identity: tuple[int, int]
    """Device and inode."""
    size: int
    """Bytes."""
    changed_at: int
    """When its contents were last changed, in ns; 0 on Windows, which reports this late."""


class Tampering(NamedTuple):
    """What another program has done to a file, and what the operator can do."""

    fact: str
    remedy: str


class FileWatch:
    """What the file of a database and its log were after this program's last change.

    Args:
        path: the database, which is open.
    """

    def __init__(self, path: Path) -> None:
        real = path.resolve()
        self._paths = str(path), str(real.with_name(f"{real.name}-wal"))
        self._known = [_state(path) for path in self._paths]

    def tampering(self) -> Tampering | None:
        """Return what another program has done to the files since the last change."""
        for path, known in zip(self._paths, self._known, strict=True):
            if known is not None and (found := _state(path)) != known:
                return _described(path, known, found)
        return None

    def note(self) -> Tampering | None:
        """Note the files after a change of this program.

        Returns what another program has done to them during the change, as far as that is seen.
        """
        before, self._known = self._known, [_state(path) for path in self._paths]
        for path, known, found in zip(self._paths, before, self._known, strict=True):
            if known is not None and (found is None or found.identity != known.identity):
                return _described(path, known, found)
        file, known_file = self._known[0], before[0]
        # A change never makes the file itself smaller. SQLite may cut its log.
        if file is not None and known_file is not None and file.size < known_file.size:
            return _described(self._paths[0], known_file, file)
        return None


def _state(path: str) -> _State | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    changed_at = 0 if sys.platform == "win32" else found.st_mtime_ns
    return _State((found.st_dev, found.st_ino), found.st_size, changed_at)


def _described(path: str, known: _State, found: _State | None) -> Tampering:
    again = "start the server again; if it refuses the file, restore a copy"
    if found is None or found.identity != known.identity:
        fact = f"{path} was removed or replaced while it was in use"
        return Tampering(fact, f"put it back, or {again}")
    fact = f"{path} was changed by another program while it was in use"
    if found.size != known.size:
        fact += f" (expected {known.size} bytes, found {found.size})"
    return Tampering(fact, again)
