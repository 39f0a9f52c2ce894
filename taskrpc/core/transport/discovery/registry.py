"""The registry of this machine: a small file for each process, in the user's runtime folder.

Every process writes what it offers, and holds an operating-system lock on its file while it lives.
A file without a lock belongs to a dead process: other processes ignore its content and remove it.
They remove nothing else: a file that is no entry stays, and no link is followed.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import sys
import time
import weakref
from collections.abc import Iterator
from pathlib import Path

from taskrpc.core.security.private_folder import PrivateFolder
from taskrpc.core.system import file_locks, folders, process_state
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.discovery.journal import TIME_STEP, Journal, JournalReader
from taskrpc.core.transport.time_of_day import time_of_day
from taskrpc.errors import NameInUse, TaskRpcError

_logger = logging.getLogger("taskrpc")

_LOCK = "lock"
"""The file that is locked during every change; its modification time is the signature."""
_NEVER = EntryChange()
"""A change that changes nothing."""
_numbers = itertools.count(1)
"""The numbers of this process's files."""


def domain_folder(domain: int) -> PrivateFolder:
    """Open the folder of a domain's registry, and create it if necessary. Raises TaskRpcError."""
    return PrivateFolder(folders.runtime_path(), f"domain_{domain}")


class Registry:
    """The registry of one domain, seen from one process."""

    def __init__(self, domain: int) -> None:
        self._folder = domain_folder(domain)
        self._name = ""
        """The name of this process's file. Each file has a new one: other processes recognise by
        its name and its first bytes how much of a file they have read."""
        self._journal: Journal | None = None
        """This process's file; None before the first change."""
        self._mine: TrackedEntry | None = None
        self._readers: dict[str, tuple[tuple[int, int], JournalReader]] = {}
        """A reader for each file, with the modification time and size at its last reading."""
        self._foreign: dict[str, tuple[int, int]] = {}
        """Files that are no entries and have no lock, with the same two values."""
        self._problem = ""
        """Why the folder could not be opened the last time, "" if it could."""
        _open_registries[self] = None

    def publish(self, tracked: TrackedEntry, change: EntryChange, *, claim: str = "") -> None:
        """Publish a change of this process's entry, and apply it to `tracked`.

        `claim` names a service that this process alone may offer. Raises NameInUse, and changes
        nothing, if another process offers it.
        """
        self._renew()
        self._write(tracked, change, claim)

    def _write(self, tracked: TrackedEntry, change: EntryChange, claim: str) -> None:
        with self._folder.locked(_LOCK):
            if claim:
                self._refuse_second(claim)
            if self._journal is None:
                self._name = f"{os.getpid()}-{next(_numbers)}-{time.time_ns():x}.json"
                self._journal = Journal(self._folder, self._name)
            self._journal.write(tracked, change)
            self._mine = tracked
            self._touch()

    def _renew(self) -> None:
        """Write this process's entry again if its file or its folder was removed or replaced.

        Raises TaskRpcError and OSError.
        """
        is_new = self._folder.renew()
        if self._journal is not None and (is_new or self._journal.was_removed()):
            self._journal.close()
            self._journal = None
        if self._journal is None and self._mine is not None:
            self._write(self._mine, _NEVER, "")

    def tracked_entries(self) -> list[TrackedEntry]:
        """The tracked entries of all living processes, this one included, oldest first."""
        mine = [] if self._mine is None else [self._mine]
        return sorted(mine + self.others(), key=lambda tracked: tracked.about.since)

    def others(self) -> list[TrackedEntry]:
        """The tracked entries of all other living processes."""
        if not self.keep_entry():
            return []
        found: list[TrackedEntry] = []
        unclear = []
        for name in self._others():
            with contextlib.suppress(OSError), self._opened(name) as descriptor:
                tracked = self._read(name, descriptor) if file_locks.is_locked(descriptor) else None
                if tracked is not None:
                    found.append(tracked)
                elif self._foreign.get(name) != _signature(descriptor):
                    unclear.append(name)
        if unclear:
            found += self._second_look(unclear)
        return found

    def entries(self) -> list[RegistryEntry]:
        """The entries of all living processes, this one included, oldest first."""
        return [tracked.entry() for tracked in self.tracked_entries()]

    def are_written_by(self, pid: int) -> bool:
        """Return whether a process wrote all entries that name its id; True if unknown.

        Another program can have written such an entry; so can one in a container, where processes
        have other ids.
        """
        self.others()
        for name, (_, reader) in self._readers.items():
            if reader.tracked is not None and reader.tracked.about.pid == pid:
                with contextlib.suppress(FileNotFoundError):  # its process has just ended
                    if not process_state.has_open(pid, self._folder.status(name)):
                        return False
        return True

    def signature(self) -> int:
        """A value that changes when any entry has changed; cheap enough to poll."""
        # One file for any number of processes: every change sets the time of the lock file.
        try:
            return self._folder.status(_LOCK).st_mtime_ns if self.keep_entry() else 0
        except OSError:
            return 0

    def keep_entry(self) -> bool:
        """Write this process's entry again if it was removed; return whether the folder is open.

        If it is not, log the reason once. Cheap enough to poll.
        """
        try:
            self._renew()
        except (TaskRpcError, OSError) as error:
            if str(error) != self._problem:
                self._problem = str(error)
                _logger.warning("this program and others do not find each other: %s", error)
            return False
        self._problem = ""
        return True

    def _touch(self) -> None:
        """Change the signature, so that waiting processes look again; called under the lock."""
        with contextlib.suppress(OSError):
            now = max(time.time_ns(), self._folder.status(_LOCK).st_mtime_ns + TIME_STEP)
            self._folder.set_time(_LOCK, now)

    def close(self) -> None:
        """Remove this process's entry."""
        if self._journal is not None:
            with contextlib.suppress(OSError, TaskRpcError):
                if sys.platform == "win32":
                    self.abandon()
                with self._folder.locked(_LOCK):
                    self._folder.remove(self._name)
                    self._touch()
            self.abandon()
        self._folder.close()

    def abandon(self) -> None:
        """Close the file without removing it: in a forked child, it belongs to the parent."""
        journal, self._journal, self._mine = self._journal, None, None
        if journal is not None:
            journal.close()

    def _refuse_second(self, claim: str) -> None:
        for name in self._others():
            with contextlib.suppress(OSError), self._opened(name) as descriptor:
                if not file_locks.is_locked(descriptor):
                    continue
                tracked = self._read(name, descriptor)
                if tracked is not None and tracked.offers(claim):
                    raise NameInUse(_second_server(claim, tracked.about))

    def _others(self) -> list[str]:
        mine = self._name if self._journal is not None else None
        names = [name for name in self._files() if name != mine]
        if len(self._readers) + len(self._foreign) > len(names):
            self._readers = {name: self._readers[name] for name in names if name in self._readers}
            self._foreign = {name: self._foreign[name] for name in names if name in self._foreign}
        return names

    def _files(self) -> list[str]:
        with contextlib.suppress(OSError):
            return [name for name in self._folder.names() if name.endswith(".json")]
        return []

    @contextlib.contextmanager
    def _opened(self, name: str) -> Iterator[int]:
        descriptor = self._folder.open_existing(name)
        try:
            yield descriptor
        finally:
            os.close(descriptor)

    def _read(self, name: str, descriptor: int) -> TrackedEntry | None:
        signature = _signature(descriptor)
        known, reader = self._readers.get(name) or (None, JournalReader())
        if known != signature or reader.tracked is None:
            reader.read(descriptor)
            self._readers[name] = signature, reader
        return reader.tracked

    def _second_look(self, names: list[str]) -> list[TrackedEntry]:
        """Read again, under the lock, files without a lock or a valid entry; remove dead entries.

        A living process may have been about to lock its file, or to write it.
        """
        found = []
        with contextlib.suppress(TaskRpcError), self._folder.locked(_LOCK):
            for name in names:
                with contextlib.suppress(OSError):
                    with self._opened(name) as descriptor:
                        alive = file_locks.is_locked(descriptor)
                        tracked = self._read(name, descriptor)
                        if tracked is None and not alive:
                            self._foreign[name] = _signature(descriptor)
                    if tracked is None:
                        continue
                    if alive:
                        found.append(tracked)
                    else:
                        self._folder.remove(name)
                        self._touch()
        return found


def _signature(descriptor: int) -> tuple[int, int]:
    """Return a file's modification time and size; every change of an entry changes them."""
    status = os.fstat(descriptor)
    return status.st_mtime_ns, status.st_size


def _second_server(name: str, entry: RegistryEntry) -> str:
    since = time.strftime("%H:%M:%S", time.localtime(entry.since))
    return (
        f"{name} is already offered by {entry.script} (pid {entry.pid}, in {entry.folder},"
        f" since {since}); end it with `taskrpc stop {entry.pid}`, or join it with --join"
        " (join=True)"
    )


_open_registries: weakref.WeakKeyDictionary[Registry, None] = weakref.WeakKeyDictionary()


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
    return RegistryEntry(pid=os.getpid(), script=_script(), folder=_folder(), since=time_of_day())


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
