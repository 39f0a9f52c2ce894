"""The simulated disk: what programs write in the scenario's folder, until the end of the run.

The first write of a run copies the folder; from then on, paths inside the folder lead to the copy.
A crash of a program loses or tears what it has not synced with `os.fsync`. A database of SQLite
syncs by itself: its commits survive.
"""

from __future__ import annotations

import builtins
import contextlib
import io
import os
import random
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias

_HARMLESS: Final = (os.devnull, "/proc/self/fd/", "/dev/fd/")
"""Paths that lead to no other file."""
_WRITES: Final = frozenset("wax+")
"""Letters of a mode with which `open` may change a file."""
_ONE_PATH: Final = (
    ("stat", False),
    ("lstat", False),
    ("listdir", False),
    ("scandir", False),
    ("access", False),
    ("readlink", False),
    ("mkdir", True),
    ("rmdir", True),
    ("remove", True),
    ("unlink", True),
    ("truncate", True),
    ("utime", True),
    ("chmod", True),
)
"""Functions of `os` whose first argument is a path, and whether they change something."""
_TWO_PATHS: Final = ("rename", "replace", "link")

_open, _os_open, _fsync = builtins.open, os.open, os.fsync
_real = {name: getattr(os, name) for name, _ in _ONE_PATH} | {
    name: getattr(os, name) for name in _TWO_PATHS if hasattr(os, name)
}


AnyPath: TypeAlias = str | bytes | os.PathLike[str] | os.PathLike[bytes] | int
"""What `open` accepts; a number is that of an open file."""


class Owner(Protocol):
    """The program that uses the disk."""

    @property
    def id(self) -> str:
        """Unique in the run."""


class _Unsynced:
    """A file with changes that were not synced."""

    def __init__(self, owner: str, before: bytes | None) -> None:
        self.owner = owner
        self.before = before
        """The content that surely survives a crash; None if there was no such file."""


class Disk:
    """The disk of one run.

    Args:
        folder: the scenario's folder.
        cannot: returns the error for something that cannot be simulated.
    """

    def __init__(self, folder: Path, cannot: Callable[[str], Exception]) -> None:
        self._folder = str(folder)
        self._cannot = cannot
        self.is_copying = False
        """Whether the disk itself uses files now."""
        self._copy = ""
        """The folder's copy; "" before the first write."""
        self._unsynced: dict[str, _Unsynced] = {}
        self._numbers: dict[int, str] = {}
        """The path of each open file by its number."""
        self._synced_by_sqlite: set[str] = set()
        """The paths of databases."""
        self._owners: dict[int, str] = {}
        """The program that has opened each of these files."""
        self._databases: dict[str, list[sqlite3.Connection]] = {}

    def path(self, path: AnyPath, *, writes: bool) -> AnyPath:
        """Return where a path leads."""
        if isinstance(path, int):
            return path
        text = os.path.abspath(os.fsdecode(path))
        inside = text == self._folder or text.startswith(self._folder + os.sep)
        if not inside:
            if writes and not text.startswith((*_HARMLESS, self._copy or os.devnull)):
                raise self._cannot(f"the file {text}, outside of the scenario's folder")
            return path
        if writes and not self._copy:
            self._begin()
        return self._copy + text[len(self._folder) :] if self._copy else path

    def opened(self, path: str, owner: Owner, before: bytes | None, number: int) -> None:
        """Note that a file was opened for writing."""
        self._numbers[number] = path
        self._owners[number] = owner.id
        if not path.startswith(tuple(self._synced_by_sqlite)):  # also PATH-wal
            self._unsynced.setdefault(path, _Unsynced(owner.id, before))

    def synced(self, number: int) -> None:
        """Note that a file was synced."""
        if (path := self._numbers.get(number)) in self._unsynced:
            self._unsynced[path].before = _content(path)

    def moved(self, source: str, target: str) -> None:
        """Note that a file has another name."""
        if (known := self._unsynced.pop(source, None)) is not None:
            self._unsynced[target] = known

    def connected(self, path: str, owner: Owner, connection: sqlite3.Connection) -> None:
        """Note a connection with a database; SQLite syncs its files from now on."""
        self._synced_by_sqlite.add(path)
        self._unsynced.pop(path, None)
        self._databases.setdefault(owner.id, []).append(connection)

    def crash(self, owner: str, chance: random.Random) -> None:
        """Lose, tear or keep what a killed program has not synced."""
        for connection in self._databases.pop(owner, []):
            connection.close()  # rolls back
        for number, name in self._owners.items():
            if name == owner:
                _unlock(number)
        for path, known in list(self._unsynced.items()):
            if known.owner == owner:
                del self._unsynced[path]
                _lose(path, known.before, chance)

    def close(self) -> None:
        """Close the databases and delete the copy."""
        for connections in self._databases.values():
            for connection in connections:
                connection.close()
        if self._copy:
            shutil.rmtree(os.path.dirname(self._copy), ignore_errors=True)

    def _begin(self) -> None:
        self.is_copying = True
        home = tempfile.mkdtemp(prefix="taskrpc-simulate-", dir=_fast_folder())
        copy = os.path.join(home, "folder")
        skip = shutil.ignore_patterns("__pycache__", ".git", ".venv", "*.pyc", "node_modules")
        shutil.copytree(self._folder, copy, ignore=skip, symlinks=True)
        self._copy = copy
        self.is_copying = False


def _unlock(number: int) -> None:
    """Free the locks of an open file, as the end of a process does."""
    if sys.platform != "win32":
        import fcntl

        with contextlib.suppress(OSError):
            fcntl.flock(number, fcntl.LOCK_UN)
        with contextlib.suppress(OSError):
            fcntl.lockf(number, fcntl.LOCK_UN)


def _fast_folder() -> str | None:
    return "/dev/shm" if os.path.isdir("/dev/shm") else None


def _content(path: str) -> bytes | None:
    try:
        with _open(path, "rb") as file:
            data: bytes = file.read()
            return data
    except OSError:
        return None


def _lose(path: str, before: bytes | None, chance: random.Random) -> None:
    after = _content(path)
    if after is None or after == before:
        return
    what = chance.random()
    if what < 0.3:
        return  # the system has written it in time
    if what < 0.6 or not after:
        if before is None:
            _real["remove"](path)
            return
        after = before
    else:  # a part of it
        after = after[: int(chance.random() * len(after))]
    with _open(path, "wb") as file:
        file.write(after)


def install(present: Callable[[], tuple[Disk, Owner] | None]) -> None:
    """Let the file functions of programs use the disk of their run.

    `present` returns the disk and the running program; None outside of programs.
    """

    def open_file(file: Any, mode: str = "r", *more: Any, **named: Any) -> Any:
        found = _of_program(present)
        if found is None or isinstance(file, int):
            return _open(file, mode, *more, **named)
        disk, owner = found
        writes = not _WRITES.isdisjoint(mode)
        path = disk.path(file, writes=writes)
        before = _content(str(path)) if writes else None
        opened = _open(path, mode, *more, **named)
        if writes:
            disk.opened(str(path), owner, before, opened.fileno())
        return opened

    def os_open(path: Any, flags: int, *more: Any, **named: Any) -> int:
        found = _of_program(present)
        if found is None:
            return _os_open(path, flags, *more, **named)
        disk, owner = found
        writes = bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
        path = disk.path(path, writes=writes)
        before = _content(path) if writes else None
        number = _os_open(path, flags, *more, **named)
        if writes:
            disk.opened(str(path), owner, before, number)
        return number

    def fsync(file: Any, /) -> None:
        _fsync(file)
        if (found := present()) is not None:
            found[0].synced(file if isinstance(file, int) else file.fileno())

    connect = sqlite3.connect

    def connect_database(database: Any, *more: Any, **named: Any) -> Any:
        found = _of_program(present)
        if found is None or str(database).startswith((":memory:", "file:")):
            return connect(database, *more, **named)
        disk, owner = found
        path = str(disk.path(database, writes=True))
        connection = connect(path, *more, **named)
        disk.connected(path, owner, connection)
        return connection

    vars(builtins)["open"] = vars(io)["open"] = open_file
    vars(os).update(open=os_open, fsync=fsync)
    vars(sqlite3)["connect"] = connect_database
    for name, writes in _ONE_PATH:
        setattr(os, name, _with_one_path(_real[name], writes, present))
    for name in _TWO_PATHS:
        if name in _real:
            setattr(os, name, _with_two_paths(_real[name], present))


_Present = Callable[[], tuple[Disk, Owner] | None]


def _of_program(present: _Present) -> tuple[Disk, Owner] | None:
    """Return the disk and the program, unless an import reads a file."""
    found = present()
    if (
        found is None
        or found[0].is_copying
        or sys._getframe(2).f_code.co_filename.startswith("<frozen importlib")
    ):
        return None
    return found


def _with_one_path(real: Callable[..., Any], writes: bool, present: _Present) -> Callable[..., Any]:
    def function(path: Any = ".", *more: Any, **named: Any) -> Any:
        found = _of_program(present)
        if found is not None and named.get("dir_fd") is None:
            path = found[0].path(path, writes=writes)
        return real(path, *more, **named)

    return function


def _with_two_paths(real: Callable[..., Any], present: _Present) -> Callable[..., Any]:
    def function(source: Any, target: Any, *more: Any, **named: Any) -> Any:
        if (found := _of_program(present)) is not None:
            disk, _ = found
            source = disk.path(source, writes=True)
            target = disk.path(target, writes=True)
            disk.moved(str(source), str(target))
        return real(source, target, *more, **named)

    return function
