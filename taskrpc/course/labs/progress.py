"""Keeps the results of a class beside its table, so that interrupted grading can go on."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping
from pathlib import Path

import msgspec

from taskrpc.course.labs.report import Graded, as_csv
from taskrpc.course.labs.submission import take
from taskrpc.errors import TaskRpcError

SUFFIX = ".progress"
"""What the name of the file with the results has after that of the table."""


class _Entry(msgspec.Struct, frozen=True):
    """A line of the file: a result, and the name and the checksum of what was graded."""

    source: str
    checksum: str
    graded: Graded


class Progress:
    """A table of points, complete after each submission, and the file with the results.

    Results of an earlier run are kept if the table exists and the submission has not changed.
    Raises OSError if the files cannot be read or written.

    Args:
        table: the table.
        checksums: of the submissions, by the names of their folders or files.
    """

    def __init__(self, table: Path, checksums: Mapping[str, str]) -> None:
        self._table = table
        self._file = table.with_name(table.name + SUFFIX)
        self._checksums = checksums
        with table.open("a") as file:  # fails now, and not after minutes
            is_new = file.tell() == 0
        self._entries = {
            each.source: each
            for each in ([] if is_new else _read(self._file))
            if each.checksum and each.checksum == checksums.get(each.source)
        }
        self._file.write_bytes(b"".join(map(_line, self._entries.values())))

    def has(self, source: str) -> bool:
        """Return whether there is a result of a submission."""
        return source in self._entries

    def add(self, source: str, graded: Graded) -> None:
        """Keep a result, and write the table; one without all checks is not kept for the next run.

        Raises OSError.
        """
        entry = _Entry(source, "" if graded.stopped else self._checksums[source], graded)
        self._entries[source] = entry
        with self._file.open("ab") as file:
            file.write(_line(entry))
        self.write()

    def write(self) -> None:
        """Write the table with all results so far. Raises OSError."""
        # The mark at the begin tells spreadsheets that it is UTF-8.
        self._table.write_text(as_csv(self.all()), encoding="utf-8-sig", newline="")

    def all(self) -> list[Graded]:
        """Return the results, by the names of the students."""
        found = [each.graded for each in self._entries.values()]
        return sorted(found, key=lambda one: one.student)


def checksum(source: Path, *settings: object) -> str:
    """Return a text that changes with a submission or the settings; "" if it cannot be read."""
    found = hashlib.sha256(repr(settings).encode())
    with tempfile.TemporaryDirectory(prefix="taskrpc-lab-") as scratch:
        copy = Path(scratch, "copy")
        try:
            take(source, copy)
        except TaskRpcError:
            return ""
        for path in sorted(each for each in copy.rglob("*") if each.is_file()):
            data = path.read_bytes()
            name = path.relative_to(copy).as_posix().encode(errors="surrogateescape")
            found.update(b"%d %s %d " % (len(name), name, len(data)) + data)
    return found.hexdigest()


def _line(entry: _Entry) -> bytes:
    return msgspec.json.encode(entry) + b"\n"


def _read(file: Path) -> list[_Entry]:
    """Return the results of a file, without lines that were not written to their end."""
    try:
        lines = file.read_bytes().splitlines()
    except FileNotFoundError:
        return []
    found = []
    for line in lines:
        try:
            found.append(msgspec.json.decode(line, type=_Entry))
        except msgspec.MsgspecError:
            continue
    return found
