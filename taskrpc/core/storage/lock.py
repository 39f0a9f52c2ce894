"""The lock beside a file: one process uses the file; a second one is refused.

The lock file also counts the commits, because SQLite does not notice a log that was removed or cut
off: acknowledged transactions would be missing without an error.
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from taskrpc.core.system import file_locks, private_files
from taskrpc.errors import StoreError

_HEAD = 80
"""Bytes of the first line, which names the process that has the lock."""
_BEGIN = b"pid "
"""The beginning of the first line."""
_LONGEST = 200
"""Bytes to read: more than a lock file has."""
_CONTENTS = re.compile(rb"pid [^\n]{75}\nstore ([0-9a-f]{32}), commit (\d{20})\n")


class FileInUse(StoreError):
    """Another process uses the file.

    Attributes:
        fact: the text without the advice.
    """

    def __init__(self, fact: str) -> None:
        self.fact = fact
        super().__init__(f"{fact}; stop that one, or give this one another file")

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.fact,), self.__dict__


class CommitCount(NamedTuple):
    """The number of transactions that a store has had."""

    store_id: bytes
    """16 bytes."""
    commits: int


class Lock:
    """The lock of a file, held from the start until `close`.

    Args:
        path: the file to lock; the lock file is `<path>.lock`.
        holder: the kind of program that uses such a file, for error texts.

    Raises:
        FileInUse: another process has the lock; the text says which.
        StoreError: the file system has no locks.
    """

    def __init__(self, path: Path, holder: str) -> None:
        self.path = path.resolve().with_name(path.resolve().name + ".lock")
        self._descriptor = private_files.open_private(self.path)
        try:
            self._take(path, holder)
            contents = self._read()
            self.commit_count = _commit_count(contents)
            """The count that the previous holder noted, None if there is none."""
            self.is_damaged = not _begins_as_lock_file(contents)
            """Whether the file has other contents than a lock file's; they stay until `note`."""
            if not self.is_damaged:
                self._write_head()
        except BaseException:
            self.close()
            raise

    @property
    def may_have_commits(self) -> bool:
        """Whether the lock has counted transactions, or may have, because it is damaged."""
        return self.is_damaged or bool(self.commit_count and self.commit_count.commits)

    def note(self, count: CommitCount) -> None:
        """Write the count of commits; a crash of the machine may lose it."""
        line = f"store {count.store_id.hex()}, commit {count.commits:020}\n".encode()
        # The transaction is on the disk already: a full disk must not refuse it here.
        with contextlib.suppress(OSError):
            if self.is_damaged:
                os.ftruncate(self._descriptor, 0)
                self._write_head()
                self.is_damaged = False
            file_locks.write_at(self._descriptor, line, _HEAD)

    @property
    def is_lost(self) -> bool:
        """Whether the lock file was removed, so that another process can take the lock."""
        return not file_locks.is_same_file(self.path, os.fstat(self._descriptor))

    def close(self) -> None:
        """Release the lock."""
        os.close(self._descriptor)

    def _take(self, path: Path, holder: str) -> None:
        try:
            is_ours = file_locks.try_lock(self._descriptor)
        except OSError as error:
            raise StoreError(
                f"{path}: its folder does not let files be locked ({error.strerror});"
                " keep it on a disk of this machine"
            ) from error
        if not is_ours:
            found = os.read(self._descriptor, _HEAD).decode(errors="replace").strip()
            raise FileInUse(f"{path} is in use by another {holder} ({found})")
        if sys.platform != "win32":  # which has no such modes
            os.fchmod(self._descriptor, 0o600)

    def _write_head(self) -> None:
        since = datetime.now().astimezone().isoformat(" ", "seconds")
        head = f"pid {os.getpid()}, since {since}".ljust(_HEAD - 1)
        file_locks.write_at(self._descriptor, f"{head}\n".encode(), 0)

    def _read(self) -> bytes:
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        return os.read(self._descriptor, _LONGEST)


def _begins_as_lock_file(contents: bytes) -> bool:
    """Return whether a file begins as a lock file.

    Only the beginning counts, and the file may be empty or end with zeros: a lock file is not
    synced, so a failure of the machine may lose its end.
    """
    begin = contents.rstrip(b"\0")[: len(_BEGIN)]
    return _BEGIN.startswith(begin)


def _commit_count(contents: bytes) -> CommitCount | None:
    found = _CONTENTS.fullmatch(contents)
    return CommitCount(bytes.fromhex(found[1].decode()), int(found[2])) if found else None
