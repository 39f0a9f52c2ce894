"""Who is where on this machine: one small file a process, in the user's runtime folder.

Every process writes what it offers, and holds an operating-system lock on its file while it lives.
A file without a lock is left over from a process that died: it is never believed, and whoever sees
it removes it. Contents begin with a checksum, so that a reader never believes half a line.
"""

from __future__ import annotations

import contextlib
import os
import time
import weakref
import zlib
from collections.abc import Iterator
from pathlib import Path

import msgspec

from taskrpc import platform
from taskrpc.errors import NameInUse
from taskrpc.wire.messages import Endpoint


class Entry(msgspec.Struct, frozen=True):
    """What one process says of itself."""

    pid: int
    script: str
    folder: str
    since: float
    """Seconds since the epoch."""
    address: str = ""
    """`host:port`, empty for a process that only calls."""
    token: str = ""
    """Hexadecimal; what a caller of `address` must prove to know."""
    nodes: tuple[str, ...] = ()
    services: tuple[Endpoint, ...] = ()
    clients: tuple[Endpoint, ...] = ()

    def offers(self, service: str) -> bool:
        """Whether the process offers a service of this absolute name."""
        return any(endpoint.name == service for endpoint in self.services)


_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(Entry).decode


class Registry:
    """The registry of one domain, seen from one process."""

    def __init__(self, domain: int) -> None:
        self._folder = platform.private_dir(platform.runtime_dir() / f"domain_{domain}")
        self._lock = self._folder / "lock"
        self._path = self._folder / f"{os.getpid()}-{id(self):x}-{time.time_ns():x}.json"
        self._descriptor = -1
        self._cache: dict[Path, tuple[tuple[int, int], Entry]] = {}
        _open_registries.add(self)

    def publish(self, entry: Entry, *, claim: str = "") -> None:
        """Write or rewrite this process's entry.

        `claim` names a service that nobody else may offer; raises NameInUse when somebody does.
        """
        with platform.locked(self._lock):
            if claim:
                self._refuse_second(claim)
            if self._descriptor < 0:
                self._descriptor = self._created()
            self._write(entry)

    def entries(self) -> list[Entry]:
        """The entries of all living processes, this one included, oldest first."""
        found = [entry for path in self._files() if (entry := self._read(path)) is not None]
        return sorted(found, key=lambda entry: entry.since)

    def signature(self) -> tuple[tuple[str, int], ...]:
        """A value that changes when any entry may have changed; cheap enough to poll."""
        signs = []
        for path in self._files():
            with contextlib.suppress(OSError):
                signs.append((path.name, path.stat().st_mtime_ns))
        return tuple(sorted(signs))

    def close(self) -> None:
        """Remove this process's entry."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                if platform.WINDOWS:
                    self.abandon()
                self._path.unlink(missing_ok=True)
            self.abandon()

    def abandon(self) -> None:
        """Close the file without removing it (a forked child's duty: the entry is its parent's)."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _created(self) -> int:
        while True:
            descriptor = platform.open_private(self._path)
            platform.lock(descriptor)
            # A reader may have taken the newborn, still unlocked file for a dead one's.
            with contextlib.suppress(OSError):
                if os.path.samestat(os.fstat(descriptor), self._path.stat()):
                    return descriptor
            os.close(descriptor)

    def _refuse_second(self, claim: str) -> None:
        for path in self._files():
            entry = self._read(path) if path != self._path else None
            if entry is not None and entry.offers(claim):
                raise NameInUse(_second_server(claim, entry))

    def _write(self, entry: Entry) -> None:
        data = _encode(entry)
        line = b"%08x %s\n" % (zlib.crc32(data), data)
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, line)
        os.ftruncate(self._descriptor, len(line))
        # Two writes within one tick of the file system's clock must still look different.
        os.utime(self._path, ns=(time.time_ns(), time.time_ns()))

    def _files(self) -> Iterator[Path]:
        with contextlib.suppress(FileNotFoundError), os.scandir(self._folder) as found:
            for item in found:
                if item.name.endswith(".json"):
                    yield Path(item.path)

    def _read(self, path: Path) -> Entry | None:
        try:
            descriptor = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        except OSError:
            return None
        try:
            if path != self._path and not platform.is_locked(descriptor):
                self._remove_dead(path)
                return None
            return self._parsed(path, descriptor)
        finally:
            os.close(descriptor)

    def _parsed(self, path: Path, descriptor: int) -> Entry | None:
        status = os.fstat(descriptor)
        sign = (status.st_mtime_ns, status.st_size)
        if path in self._cache and self._cache[path][0] == sign:
            return self._cache[path][1]
        line = os.read(descriptor, status.st_size).partition(b"\n")[0]
        checksum, _, data = line.partition(b" ")
        if checksum != b"%08x" % zlib.crc32(data):
            return None
        with contextlib.suppress(msgspec.MsgspecError):
            entry = _decode(data)
            self._cache[path] = (sign, entry)
            return entry
        return None

    def _remove_dead(self, path: Path) -> None:
        self._cache.pop(path, None)
        with contextlib.suppress(OSError):
            path.unlink()


def _second_server(name: str, entry: Entry) -> str:
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
    # A child that kept the descriptor would hold its dead parent's lock.
    os.register_at_fork(after_in_child=_abandon_all)
