"""The file in which a process says what it has: a whole entry, then a line for each change.

A line is a checksum, a number and JSON. Numbers count on for as long as the process lives, so a
reader that believes only the line behind the last one it knows never takes a torn line, or what is
left of an older one, for the truth. Changes that outgrow the entry are rolled up into a new one.
"""

from __future__ import annotations

import os
import time
import zlib
from pathlib import Path

import msgspec

from taskrpc import platform
from taskrpc.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry

_SLACK = 4096
"""Bytes of changes that are never worth a new entry."""
_HEAD = 32
"""Bytes at the beginning of a file that tell one entry from the next: they hold its number."""
TIME_STEP = 1000
"""Nanoseconds that every file system can tell apart."""

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(RegistryEntry | EntryChange).decode


def line_of(number: int, record: RegistryEntry | EntryChange) -> bytes:
    """A record as it stands in a journal."""
    text = b"%d %s" % (number, _encode(record))
    return b"%08x %s\n" % (zlib.crc32(text), text)


class Journal:
    """This process's file, made and locked; one thread at a time may write."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor = platform.open_private(path)
        platform.lock(self._descriptor)
        self._number = 0
        self._size = 0
        self._room = 0
        self._written = 0

    def write(self, tracked: TrackedEntry, change: EntryChange) -> None:
        """Write down a change of what is in a tracked, which takes note of it then."""
        if self._size >= self._room:
            self._roll_up(tracked)
        self._append(line_of(self._number + 1, change))
        tracked.apply(change)
        # Two writes within one tick of the system's clock must still look different.
        self._written = max(time.time_ns(), self._written + TIME_STEP)
        os.utime(self._path, ns=(self._written, self._written))

    def close(self) -> None:
        """Close the file, and so give up its lock."""
        os.close(self._descriptor)

    def _roll_up(self, tracked: TrackedEntry) -> None:
        whole = line_of(self._number + 1, tracked.entry())
        old = self._size
        # Behind all that it replaces at first, so that wherever this ends, one of them is whole.
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

    def _write_at(self, place: int, data: bytes) -> None:
        os.lseek(self._descriptor, place, os.SEEK_SET)
        left = memoryview(data)
        while left:
            left = left[os.write(self._descriptor, left) :]


class JournalReader:
    """What the journal of another process says; reads on from where it stopped."""

    def __init__(self) -> None:
        self.tracked: TrackedEntry | None = None
        """None as long as nothing could be believed."""
        self._number = 0
        self._head = b""
        self._place = 0

    def read(self, descriptor: int) -> None:
        """Bring the tracked up to date."""
        if self._head:
            self._take(_contents(descriptor, self._place))
            if _contents(descriptor, 0, _HEAD) == self._head:
                return
        self.tracked, self._number, self._head, self._place = None, 0, b"", 0
        data = _contents(descriptor, 0)
        if self._take(data) == 0:
            self._head = data[:_HEAD]

    def _take(self, data: bytes) -> int:
        """Take note of these lines; returns where the newest whole entry among them begins."""
        began, place = -1, self._place
        for line in data.split(b"\n")[:-1]:
            number, record = _parsed(line)
            if isinstance(record, RegistryEntry) and number > self._number:
                began, self.tracked = place, TrackedEntry(record)
            elif isinstance(record, EntryChange) and self.tracked and number == self._number + 1:
                self.tracked.apply(record)
            else:
                number = 0
            place += len(line) + 1
            if number:
                self._number, self._place = number, place
        return began


def _parsed(line: bytes) -> tuple[int, RegistryEntry | EntryChange | None]:
    checksum, _, text = line.partition(b" ")
    if checksum != b"%08x" % zlib.crc32(text):
        return 0, None
    number, _, record = text.partition(b" ")
    try:
        return int(number), _decode(record)
    except (ValueError, msgspec.MsgspecError):
        return 0, None


def _contents(descriptor: int, place: int, size: int = -1) -> bytes:
    """A file's bytes from a place on, at most `size` of them."""
    os.lseek(descriptor, place, os.SEEK_SET)
    if size < 0:
        size = max(0, os.fstat(descriptor).st_size - place)
    return os.read(descriptor, size)
