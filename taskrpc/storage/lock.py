"""The lock beside a file: one process uses the file; a second one is refused.

The lock file also counts the commits. SQLite cannot tell a log that lost its end, or is gone, from
a shorter one: acknowledged transactions would be missing without an error.
"""

from __future__ import annotations

import contextlib
import os
import re
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from taskrpc import platform
from taskrpc.errors import StoreError

_HEAD = 80
"""Bytes of the first line, which names the process that has the lock."""
_LONGEST = 200
"""Bytes to read: more than a lock file has."""
_CONTENTS = re.compile(rb"pid [^\n]{75}\n(?:store ([0-9a-f]{32}), commit (\d{20})\n)?")


class FileInUse(StoreError):
    """Another process uses the file.

    Attributes:
        fact: the sentence without what to do about it.
    """

    def __init__(self, fact: str) -> None:
        self.fact = fact
        super().__init__(f"{fact}; stop that one, or give this one another file")

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.fact,), self.__dict__


class Witness(NamedTuple):
    """The count of commits when a file was last changed."""

    store_id: bytes
    commits: int


class Lock:
    """The lock of a file, held from the start until `close`.

    `holder` says what uses such files.

    Raises:
        FileInUse: another process has it; the text says which.
        StoreError: nobody can have it.
    """

    def __init__(self, path: Path, holder: str) -> None:
        self.path = path.resolve().with_name(path.resolve().name + ".lock")
        self._descriptor = platform.open_private(self.path)
        try:
            self._take(path, holder)
            contents = self._read()
            found = _CONTENTS.fullmatch(contents)
            self.witness = _witness(found) if found else None
            """The count that the previous holder noted, if any."""
            self.is_damaged = not found and not _is_torn(contents)
            """Whether the file has other contents than a lock's; they stay until `note`."""
            if not self.is_damaged:
                self._write_head()
        except BaseException:
            self.close()
            raise

    def note(self, witness: Witness) -> None:
        """Note the count of commits; a crash of the machine may lose the note."""
        line = f"store {witness.store_id.hex()}, commit {witness.commits:020}\n".encode()
        # No room for these bytes is no reason to refuse what is on the disk already.
        with contextlib.suppress(OSError):
            if self.is_damaged:
                os.ftruncate(self._descriptor, 0)
                self._write_head()
                self.is_damaged = False
            platform.write_at(self._descriptor, line, _HEAD)

    @property
    def is_lost(self) -> bool:
        """Whether the lock's file was removed, so that others may believe the lock to be free."""
        return not platform.is_same_file(self.path, os.fstat(self._descriptor))

    def close(self) -> None:
        """Let others have the lock."""
        os.close(self._descriptor)

    def _take(self, path: Path, holder: str) -> None:
        try:
            is_ours = platform.try_lock(self._descriptor)
        except OSError as error:
            raise StoreError(
                f"{path}: its folder does not let files be locked ({error.strerror});"
                " keep it on a disk of this machine"
            ) from error
        if not is_ours:
            found = os.read(self._descriptor, _HEAD).decode(errors="replace").strip()
            raise FileInUse(f"{path} is in use by another {holder} ({found})")
        self.path.chmod(0o600)

    def _write_head(self) -> None:
        since = datetime.now().astimezone().isoformat(" ", "seconds")
        head = f"pid {os.getpid()}, since {since}".ljust(_HEAD - 1)
        platform.write_at(self._descriptor, f"{head}\n".encode(), 0)

    def _read(self) -> bytes:
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        return os.read(self._descriptor, _LONGEST)


def _is_torn(contents: bytes) -> bool:
    """Whether a failure of the machine at the very first start can have left these contents.

    The first line is not synced: a part of it may be on the disk, or zeros.
    """
    begin = b"pid "
    return contents.startswith(begin) or begin.startswith(contents.rstrip(b"\0"))


def _witness(contents: re.Match[bytes]) -> Witness | None:
    store_id, commits = contents.groups()
    return Witness(bytes.fromhex(store_id.decode()), int(commits)) if store_id else None
