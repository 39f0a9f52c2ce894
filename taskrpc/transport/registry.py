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
    certificate: str = ""
    """PEM; what a caller of `address` must be shown, "" where it is a plain connection."""
    nodes: tuple[str, ...] = ()
    services: tuple[Endpoint, ...] = ()
    clients: tuple[Endpoint, ...] = ()

    def __repr__(self) -> str:
        # Without the token: what is printed ends in logs.
        return f"Entry(pid={self.pid}, script={self.script!r}, address={self.address!r})"

    def offers(self, service: str) -> bool:
        """Whether the process offers a service of this absolute name."""
        return any(endpoint.name == service for endpoint in self.services)


_TIME_STEP = 1000
"""Nanoseconds that every file system can tell apart."""

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(Entry).decode


class Registry:
    """The registry of one domain, seen from one process."""

    def __init__(self, domain: int) -> None:
        self._folder = platform.private_dir(platform.runtime_dir() / f"domain_{domain}")
        self._lock = self._folder / "lock"
        self._path = self._folder / f"{os.getpid()}-{id(self):x}-{time.time_ns():x}.json"
        self._descriptor = -1
        self._written = 0
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
        found, unclear = [], []
        for path in self._files():
            with contextlib.suppress(OSError), self._opened(path) as descriptor:
                alive = self._is_alive(path, descriptor)
                entry = self._parsed(path, descriptor) if alive else None
                if entry is None:
                    unclear.append(path)
                else:
                    found.append(entry)
        if unclear:
            found += self._second_look(unclear)
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
        descriptor = platform.open_private(self._path)
        platform.lock(descriptor)
        return descriptor

    def _refuse_second(self, claim: str) -> None:
        for path in self._files():
            with contextlib.suppress(OSError), self._opened(path) as descriptor:
                if path == self._path or not self._is_alive(path, descriptor):
                    continue
                entry = self._parsed(path, descriptor)
                if entry is not None and entry.offers(claim):
                    raise NameInUse(_second_server(claim, entry))

    def _write(self, entry: Entry) -> None:
        data = _encode(entry)
        line = b"%08x %s\n" % (zlib.crc32(data), data)
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, line)
        os.ftruncate(self._descriptor, len(line))
        # Two writes within one tick of the system's clock must still look different.
        self._written = max(time.time_ns(), self._written + _TIME_STEP)
        os.utime(self._path, ns=(self._written, self._written))

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

    def _parsed(self, path: Path, descriptor: int) -> Entry | None:
        status = os.fstat(descriptor)
        sign = (status.st_mtime_ns, status.st_size)
        if path in self._cache and self._cache[path][0] == sign:
            return self._cache[path][1]
        entry = _entry_in(os.read(descriptor, status.st_size))
        if entry is not None:
            self._cache[path] = (sign, entry)
        return entry

    def _is_alive(self, path: Path, descriptor: int) -> bool:
        return path == self._path or platform.is_locked(descriptor)

    def _second_look(self, paths: list[Path]) -> list[Entry]:
        """The entries that were only just being made or written; the dead ones' are removed."""
        found = []
        with platform.locked(self._lock):
            for path in paths:
                with contextlib.suppress(OSError):
                    with self._opened(path) as descriptor:
                        alive = self._is_alive(path, descriptor)
                        entry = self._parsed(path, descriptor)
                    if not alive:
                        self._cache.pop(path, None)
                        path.unlink()
                    elif entry is not None:
                        found.append(entry)
        return found


def _entry_in(data: bytes) -> Entry | None:
    checksum, _, text = data.partition(b"\n")[0].partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        return None
    try:
        return _decode(text)
    except msgspec.MsgspecError:
        return None


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
