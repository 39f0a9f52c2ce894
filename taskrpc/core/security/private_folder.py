"""A folder that only this user can enter; its files are reached through the folder's descriptor.

A path is looked up again at each use. So a program could put a link in the folder's place after the
folder was checked. A descriptor stays with the checked folder. Windows has no such descriptors:
there, each file's path is checked for links before it is used.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import weakref
from collections.abc import Iterator
from pathlib import Path

from taskrpc.core.system import file_locks, private_files
from taskrpc.errors import TaskRpcError

_HAS_DIR_FD = {os.open, os.stat, os.unlink, os.mkdir} <= os.supports_dir_fd


class PrivateFolder:
    """A folder that is made if necessary, checked once, and opened once.

    If the folder is removed or replaced later, `renew` makes, checks and opens it again.

    Args:
        root: the first folder to check. The folders above it belong to the system, or the user
            has named them.
        below: the names of the folders from there; the last one is this folder.

    Raises:
        TaskRpcError: a folder cannot be made, is a link, or belongs to another user.
    """

    def __init__(self, root: Path, *below: str) -> None:
        self._root, self._below = root, below
        self.path = root.joinpath(*below)
        self._descriptor: int | None = None
        """None on Windows, and while the folder is closed."""
        self._known: tuple[int, int] | None = None
        """The device and inode of the opened folder; None while it is closed."""
        self._close: weakref.finalize[[int], PrivateFolder] | None = None
        self.renew()

    def renew(self) -> bool:
        """Open the folder again if its path does not lead to it any more; return whether it did.

        Raises TaskRpcError.
        """
        with contextlib.suppress(OSError):
            found = os.lstat(self.path)
            if (found.st_dev, found.st_ino) == self._known:
                return False
        self.close()
        descriptor = _open_chain(self._root, self._below)
        if descriptor is None:
            found = os.lstat(self.path)
        else:
            self._close = weakref.finalize(self, os.close, descriptor)
            found = os.fstat(descriptor)
        self._descriptor, self._known = descriptor, (found.st_dev, found.st_ino)
        return True

    def close(self) -> None:
        """Close the descriptor; `renew` opens the folder again."""
        self._descriptor = self._known = None
        if self._close is not None:
            self._close()
            self._close = None

    def names(self) -> list[str]:
        """Return the names of everything in the folder. Raises OSError."""
        return os.listdir(self.path if self._descriptor is None else self._descriptor)

    def open(self, name: str, *, must_be_new: bool = False) -> int:
        """Open or create a file of this folder for reading and writing; return the descriptor.

        Raises OSError, also for a link, a hard link, a pipe, a folder, and another user's file.
        """
        path = self._checked(name)
        return _regular(
            private_files.open_private(path, must_be_new=must_be_new, dir_fd=self._descriptor), name
        )

    def open_existing(self, name: str) -> int:
        """Open a file for reading and writing; like `open`, but it does not create the file."""
        path = self._checked(name)
        return _regular(os.open(path, private_files.OPEN_FLAGS, dir_fd=self._descriptor), name)

    def status(self, name: str) -> os.stat_result:
        """Return the status of what has this name, which may be a link. Raises OSError."""
        return os.stat(self._at(name), dir_fd=self._descriptor, follow_symlinks=False)

    def set_time(self, name: str, nanoseconds: int) -> None:
        """Set the modification time of a file. Raises OSError."""
        times, path = (nanoseconds, nanoseconds), self._checked(name)
        if self._descriptor is None:  # Windows cannot set the times of a link itself
            os.utime(path, ns=times)
        else:
            os.utime(path, ns=times, dir_fd=self._descriptor, follow_symlinks=False)

    def remove(self, name: str) -> None:
        """Remove a file, or a link but not its target. Raises OSError."""
        os.unlink(self._at(name), dir_fd=self._descriptor)

    @contextlib.contextmanager
    def locked(self, name: str) -> Iterator[None]:
        """Wait for the lock of a lock file, and hold it while the block runs.

        Raises TaskRpcError if the file cannot be opened or locked.
        """
        try:
            descriptor = self.open(name)
        except OSError as error:
            raise self._no_lock(name, error) from None
        try:
            try:
                file_locks.lock(descriptor)
            except OSError as error:
                raise self._no_lock(name, error) from None
            yield
        finally:
            os.close(descriptor)

    def _no_lock(self, name: str, error: OSError) -> TaskRpcError:
        return TaskRpcError(f"cannot lock {self.path / name}: {error.strerror}")

    def _at(self, name: str) -> str:
        return name if self._descriptor is not None else str(self.path / name)

    def _checked(self, name: str) -> str:
        """Return the path of a file; on Windows, refuse a link. Raises OSError."""
        path = self._at(name)
        if self._descriptor is None:
            with contextlib.suppress(FileNotFoundError):
                if private_files.is_link(os.lstat(path)):
                    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), path)
        return path


def _open_chain(root: Path, below: tuple[str, ...]) -> int | None:
    """Return the descriptor of the last folder, None on Windows. Raises TaskRpcError."""
    path = root
    descriptor = private_files.open_private_dir(root) if _HAS_DIR_FD else None
    if descriptor is None:
        private_files.private_dir(root)
    for name in below:
        path /= name
        if descriptor is None:
            private_files.private_dir(path)
            continue
        outer = descriptor
        try:
            descriptor = private_files.open_private_dir(path, dir_fd=outer)
        finally:
            os.close(outer)
    return descriptor


def _regular(descriptor: int, name: str) -> int:
    """Return the descriptor of a regular file of this user's that has one name only.

    Closes it and raises OSError if it is anything else.
    """
    found = os.fstat(descriptor)
    # A removed file has no name any more.
    if (
        stat.S_ISREG(found.st_mode)
        and found.st_nlink <= 1
        and private_files.is_this_user(found.st_uid)
    ):
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EPERM, "expected a regular file of this user's with one name", name)
