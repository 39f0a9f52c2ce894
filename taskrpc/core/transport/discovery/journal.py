"""The file format of a registry entry: the whole entry, then a line for each change.

A line consists of a checksum, a number and JSON. The numbers increase as long as the process lives.
A reader accepts a change only if its number follows the last one. So it never accepts an incomplete
line, or the rest of an old one. When the changes outgrow the entry, a new whole entry replaces all.
"""

from __future__ import annotations

import contextlib
import os
import time
from binascii import crc32  # asyncio has imported it; zlib would load another library
from functools import cache

import msgspec

from taskrpc.core.security.private_folder import PrivateFolder
from taskrpc.core.system import file_locks
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry

_SLACK = 4096
"""Bytes of changes that a file may have besides twice its whole entry."""
_HEAD = 32
"""Bytes at the beginning of a file that differ between whole entries: they contain the number."""
LONGEST = 64 * 2**20
"""Bytes of the longest file that is read; the entry of a million services is shorter."""
TIME_STEP = 1000
"""Nanoseconds; every file system stores times at least this precisely."""

_encode = msgspec.json.Encoder().encode


@cache
def _decoder() -> msgspec.json.Decoder[RegistryEntry | EntryChange]:
    """Return the decoder of records; a process that sees no other one needs none."""
    return msgspec.json.Decoder(RegistryEntry | EntryChange)


def line_of(number: int, record: RegistryEntry | EntryChange) -> bytes:
    """Return a record as a line of the file."""
    text = b"%d %s" % (number, _encode(record))
    return b"%08x %s\n" % (crc32(text), text)


class Journal:
    """Creates, locks and writes this process's file; only one thread may write at a time."""

    def __init__(self, folder: PrivateFolder, name: str) -> None:
        self._folder, self._name = folder, name
        self._descriptor = folder.open(name)
        file_locks.lock(self._descriptor)
        self._number = 0
        """The number of the last line."""
        self._size = 0
        self._room = 0
        """The size in bytes from which a new whole entry is due."""
        self._written = 0
        """The file's modification time (nanoseconds)."""

    def write(self, tracked: TrackedEntry, change: EntryChange) -> None:
        """Write a change, then apply it to the tracked entry. Raises OSError."""
        if self._size >= self._room:
            self._write_whole(tracked)
        self._append(line_of(self._number + 1, change))
        tracked.apply(change)
        # Two writes within one tick of the system's clock must still differ in their times.
        self._written = max(time.time_ns(), self._written + TIME_STEP)
        with contextlib.suppress(OSError):  # removed: no other process can read it
            self._folder.set_time(self._name, self._written)

    def was_removed(self) -> bool:
        """Return whether the file has no name any more; it is still open and locked."""
        return os.fstat(self._descriptor).st_nlink == 0

    def close(self) -> None:
        """Close the file, which releases its lock."""
        os.close(self._descriptor)

    def _write_whole(self, tracked: TrackedEntry) -> None:
        whole = line_of(self._number + 1, tracked.entry())
        old = self._size
        # First behind the old content, then at the beginning: one valid entry remains even if the
        # process dies between the writes.
        self._append(b"\n" * (len(whole) - old if old else 0) + whole)
        if old:
            self._write_at(0, whole)
            os.ftruncate(self._descriptor, len(whole))
            self._size = len(whole)
        self._room = 2 * len(whole) + _SLACK

    def _append(self, line: bytes) -> None:
        try:
            self._write_at(self._size, line)
        except OSError:  # the disk is full
            os.ftruncate(self._descriptor, self._size)
            raise
        self._size += len(line)
        self._number += 1

    def _write_at(self, offset: int, data: bytes) -> None:
        os.lseek(self._descriptor, offset, os.SEEK_SET)
        left = memoryview(data)
        while left:
            left = left[os.write(self._descriptor, left) :]


class JournalReader:
    """Reads the file of another process; each `read` continues where the last one stopped."""

    def __init__(self) -> None:
        self.tracked: TrackedEntry | None = None
        """None as long as no valid entry was read."""
        self._number = 0
        """The number of the last valid line."""
        self._head = b""
        """The file's first bytes; if they change, it has a new whole entry."""
        self._offset = 0
        """The offset behind the last valid line."""

    def read(self, descriptor: int) -> None:
        """Read the new lines, and update `tracked`."""
        if self._head:
            self._take(_contents(descriptor, self._offset))
            if _contents(descriptor, 0, _HEAD) == self._head:
                return
        self.tracked, self._number, self._head, self._offset = None, 0, b"", 0
        data = _contents(descriptor, 0)
        if self._take(data) == 0:
            self._head = data[:_HEAD]

    def _take(self, data: bytes) -> int:
        """Apply these lines; return the offset of the newest whole entry among them, else -1."""
        began, offset = -1, self._offset
        for line in data.split(b"\n")[:-1]:
            number, record = _parsed(line)
            if isinstance(record, RegistryEntry) and number > self._number:
                began, self.tracked = offset, TrackedEntry(record)
            elif isinstance(record, EntryChange) and self.tracked and number == self._number + 1:
                self.tracked.apply(record)
            else:
                number = 0
            offset += len(line) + 1
            if number:
                self._number, self._offset = number, offset
        return began


def _parsed(line: bytes) -> tuple[int, RegistryEntry | EntryChange | None]:
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % crc32(text):
        return 0, None
    number, _, record = text.partition(b" ")
    try:
        return int(number), _decoder().decode(record)
    except (ValueError, msgspec.MsgspecError):
        return 0, None


def _contents(descriptor: int, offset: int, size: int = -1) -> bytes:
    """Return a file's bytes from an offset on, at most `size` of them."""
    os.lseek(descriptor, offset, os.SEEK_SET)
    if size < 0:
        size = max(0, os.fstat(descriptor).st_size - offset)
    return os.read(descriptor, min(size, LONGEST))
