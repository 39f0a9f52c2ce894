"""Lock files: one process at a time holds a file, and may write into it who it is."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator

from taskrpc.core.system import private_files

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path

_LOCK_OFFSET = 0x7FFF_0000  # far behind the contents: Windows forbids reading locked bytes
_LONGEST_HOLD, _LOCK_RETRY = 10.0, 0.002  # seconds; how long and how often to try a Windows lock
_HELD = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)  # errors for a lock that another process has


def lock(descriptor: int) -> None:
    """Wait for the file's lock and take it; the system releases it when the process ends."""
    _lock(descriptor, wait=True)


def try_lock(descriptor: int) -> bool:
    """Take the file's lock if it is free; returns whether it was.

    The system releases it when the process ends. Raises OSError if the file system has no locks.
    """
    try:
        _lock(descriptor, wait=False)
    except OSError as error:
        if error.errno not in _HELD:
            raise
        return False
    return True


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait for the lock of a lock file, and hold it while the block runs."""
    descriptor = private_files.open_private(path)
    try:
        _lock(descriptor, wait=True)
        yield
    finally:
        os.close(descriptor)


if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int, *, wait: bool, offset: int = _LOCK_OFFSET) -> None:
        # Do not use LK_LOCK: it sleeps a whole second between two attempts.
        import time

        give_up = time.monotonic() + _LONGEST_HOLD if wait else 0.0
        while True:
            try:
                return _locking(descriptor, msvcrt.LK_NBLCK, offset)
            except OSError as error:
                if error.errno not in _HELD or time.monotonic() >= give_up:
                    raise
            time.sleep(_LOCK_RETRY)

    def _locking(descriptor: int, mode: int, offset: int = _LOCK_OFFSET) -> None:
        # Windows locks at the current position; the caller reads from the beginning afterwards.
        os.lseek(descriptor, offset, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, mode, 1)
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)

    def is_locked(descriptor: int) -> bool:
        """Whether a process holds the file's lock."""
        # One after the other: two programs that check at once would name each other as holder.
        _lock(descriptor, wait=True, offset=_LOCK_OFFSET + 1)
        try:
            if not try_lock(descriptor):
                return True
            _locking(descriptor, msvcrt.LK_UNLCK)
            return False
        finally:
            _locking(descriptor, msvcrt.LK_UNLCK, _LOCK_OFFSET + 1)

else:
    import fcntl

    def _lock(descriptor: int, *, wait: bool) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))

    def is_locked(descriptor: int) -> bool:
        """Whether a process holds the file's lock."""
        try:
            # Shared, so that two programs that check at once do not name each other as holder.
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
        fcntl.flock(descriptor, fcntl.LOCK_UN)
        return False


def is_same_file(path: Path, known: os.stat_result) -> bool:
    """Return whether a path still leads to a known file, which must be open."""
    try:  # on Windows an open file cannot be removed or replaced
        return sys.platform == "win32" or os.path.samestat(os.stat(path), known)
    except OSError:
        return False


def write_at(descriptor: int, data: bytes, offset: int) -> None:
    """Write into the middle of an open file; the file's position afterwards is undefined."""
    if sys.platform == "win32":
        os.lseek(descriptor, offset, os.SEEK_SET)
        os.write(descriptor, data)
    else:
        os.pwrite(descriptor, data, offset)
