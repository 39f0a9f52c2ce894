"""The registry of this machine: a small file for each process, in the user's runtime folder.

Every process writes what it offers, and holds an operating-system lock on its file while it lives.
A file without a lock belongs to a dead process: other processes ignore its content and remove it.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
import weakref
from collections.abc import Iterator
from pathlib import Path

from taskrpc import platform
from taskrpc.errors import NameInUse
from taskrpc.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.transport.discovery.journal import TIME_STEP, Journal, JournalReader


class Registry:
    """The registry of one domain, seen from one process."""

    def __init__(self, domain: int) -> None:
        self._folder = platform.private_dir(platform.runtime_dir() / f"domain_{domain}")
        self._lock = self._folder / "lock"
        """Locked during every change; its modification time is the registry's signature."""
        self._path = self._folder / f"{os.getpid()}-{id(self):x}-{time.time_ns():x}.json"
        self._journal: Journal | None = None
        """This process's file; None before the first change."""
        self._mine: TrackedEntry | None = None
        self._readers: dict[Path, tuple[tuple[int, int], JournalReader]] = {}
        """A reader for each file, with the modification time and size at its last reading."""
        _open_registries.add(self)

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Publish a change of this process's entry, and apply it to `tracked`.

        `claim` names a service that this process alone may offer. Raises NameInUse, and changes
        nothing, if another process offers it.
        """
        with platform.locked(self._lock):
            if claim:
                self._refuse_second(claim)
            if self._journal is None:
                self._journal = Journal(self._path)
            self._journal.write(tracked, change)
            self._mine = tracked
            self._touch()

    def tracked_entries(self) -> list[TrackedEntry]:
        """The tracked entries of all living processes, this one included, oldest first."""
        mine = [] if self._mine is None else [self._mine]
        return sorted(mine + self.others(), key=lambda tracked: tracked.about.since)

    def others(self) -> list[TrackedEntry]:
        """The tracked entries of all other living processes."""
        found: list[TrackedEntry] = []
        unclear = []
        for path in self._others():
            with contextlib.suppress(OSError), self._opened(path) as descriptor:
                tracked = self._read(path, descriptor) if platform.is_locked(descriptor) else None
                if tracked is None:
                    unclear.append(path)
                else:
                    found.append(tracked)
        if unclear:
            found += self._second_look(unclear)
        return found

    def entries(self) -> list[RegistryEntry]:
        """The entries of all living processes, this one included, oldest first."""
        return [tracked.entry() for tracked in self.tracked_entries()]

    def signature(self) -> int:
        """A value that changes when any entry has changed; cheap enough to poll."""
        # One file for any number of processes: every change sets the time of the lock file.
        try:
            return os.stat(self._lock).st_mtime_ns
        except OSError:
            return 0

    def _touch(self) -> None:
        """Change the signature, so that waiting processes look again; called under the lock."""
        now = max(time.time_ns(), self.signature() + TIME_STEP)
        with contextlib.suppress(OSError):
            os.utime(self._lock, ns=(now, now))

    def close(self) -> None:
        """Remove this process's entry."""
        if self._journal is not None:
            with contextlib.suppress(OSError):
                if sys.platform == "win32":
                    self.abandon()
                with platform.locked(self._lock):
                    self._path.unlink(missing_ok=True)
                    self._touch()
            self.abandon()

    def abandon(self) -> None:
        """Close the file without removing it: in a forked child, it belongs to the parent."""
        journal, self._journal, self._mine = self._journal, None, None
        if journal is not None:
            journal.close()

    def _refuse_second(self, claim: str) -> None:
        for path in self._others():
            with contextlib.suppress(OSError), self._opened(path) as descriptor:
                if not platform.is_locked(descriptor):
                    continue
                tracked = self._read(path, descriptor)
                if tracked is not None and tracked.offers(claim):
                    raise NameInUse(_second_server(claim, tracked.about))

    def _others(self) -> list[Path]:
        mine = self._path if self._journal is not None else None
        paths = [path for path in self._files() if path != mine]
        if len(self._readers) > len(paths):
            self._readers = {path: self._readers[path] for path in paths if path in self._readers}
        return paths

    def _files(self) -> Iterator[Path]:
        with contextlib.suppress(OSError), os.scandir(self._folder) as found:
            for item in found:
                if item.name.endswith(".json"):
                    yield Path(item.path)

    @contextlib.contextmanager
    def _opened(self, path: Path) -> Iterator[int]:
        flags = os.O_RDWR | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)
        descriptor = os.open(path, flags)
        try:
            yield descriptor
        finally:
            os.close(descriptor)

    def _read(self, path: Path, descriptor: int) -> TrackedEntry | None:
        status = os.fstat(descriptor)
        signature = (status.st_mtime_ns, status.st_size)
        known, reader = self._readers.get(path) or (None, JournalReader())
        if known != signature or reader.tracked is None:
            reader.read(descriptor)
            self._readers[path] = signature, reader
        return reader.tracked

    def _second_look(self, paths: list[Path]) -> list[TrackedEntry]:
        """Read again, under the lock, files without a lock or a valid entry; remove dead ones.

        A living process may have been about to lock its file, or to write it.
        """
        found = []
        with platform.locked(self._lock):
            for path in paths:
                with contextlib.suppress(OSError):
                    with self._opened(path) as descriptor:
                        alive = platform.is_locked(descriptor)
                        tracked = self._read(path, descriptor)
                    if not alive:
                        path.unlink()
                        self._touch()
                    elif tracked is not None:
                        found.append(tracked)
        return found


def _second_server(name: str, entry: RegistryEntry) -> str:
    since = time.strftime("%H:%M:%S", time.localtime(entry.since))
    return (
        f"{name} is already offered by {entry.script} (pid {entry.pid}, in {entry.folder},"
        f" since {since}); end it with `taskrpc stop {entry.pid}`, or join it with --join"
        " (join=True)"
    )


_open_registries: weakref.WeakSet[Registry] = weakref.WeakSet()


def _abandon_all() -> None:
    for registry in list(_open_registries):
        registry.abandon()


if hasattr(os, "register_at_fork"):
    # If a child kept the descriptor, the lock would outlive the parent.
    os.register_at_fork(after_in_child=_abandon_all)


_KERNEL = "ipykernel_launcher.py"
"""The program that runs the cells of a notebook in Python."""


def this_process() -> RegistryEntry:
    """Return this process's entry, still without nodes and services."""
    return RegistryEntry(pid=os.getpid(), script=_script(), folder=_folder(), since=time.time())


def _script() -> str:
    """Return the program's name for users: a command's name, a script's path, or a notebook."""
    program = Path(sys.argv[0]) if sys.argv and sys.argv[0] else Path("python")
    name = program.name
    if name == _KERNEL:
        notebook = os.environ.get("JPY_SESSION_NAME", "")
        name = f"notebook {Path(notebook).name}" if notebook else "a notebook"
    elif program.suffix == ".py":
        name = str(program)
        with contextlib.suppress(ValueError, OSError):
            name = str(program.resolve().relative_to(Path.cwd()))
    # A file name need not be valid text, but the entry must be.
    return name.encode(errors="replace").decode()


def _folder() -> str:
    try:
        return str(Path.cwd()).encode(errors="replace").decode()
    except OSError:  # the folder was deleted
        return "?"
