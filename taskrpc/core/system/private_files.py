"""Files and folders that only this user can read or enter: made, opened, checked, written."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
from collections.abc import Iterator

from taskrpc.errors import TaskRpcError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path

_FOLDER_FLAGS = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0)
OPEN_FLAGS = (
    os.O_RDWR
    | getattr(os, "O_BINARY", 0)
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
)
"""How this user's private files are opened: no link is followed, and a pipe does not block."""


def private_dir(path: Path) -> Path:
    """Make a folder that only this user can enter, or check that it is one.

    Raises TaskRpcError if it cannot be made, is a link, or belongs to another user.
    """
    if sys.platform != "win32":
        os.close(open_private_dir(path))
        return path
    else:
        try:
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            found = path.lstat()
        except OSError as error:
            raise TaskRpcError(f"cannot make the folder {path}: {error.strerror}") from None
        if not stat.S_ISDIR(found.st_mode) or is_link(found):
            raise _not_a_folder(path)
        return path


def open_private_dir(path: Path, *, dir_fd: int | None = None) -> int:
    """Make a folder that only this user can enter, or check that it is one; return a descriptor.

    With `dir_fd`, the descriptor of the folder above, only the last name of the path is looked up.
    Not on Windows. Raises TaskRpcError as `private_dir` does.
    """
    name = path if dir_fd is None else path.name
    flags = _FOLDER_FLAGS
    try:
        try:
            descriptor = os.open(name, flags, dir_fd=dir_fd)
        except FileNotFoundError:
            if dir_fd is None:
                path.mkdir(mode=0o700, parents=True, exist_ok=True)
            else:
                with contextlib.suppress(FileExistsError):
                    os.mkdir(name, 0o700, dir_fd=dir_fd)
            descriptor = os.open(name, flags, dir_fd=dir_fd)
    except OSError as error:
        raise _no_folder(path, name, dir_fd, error) from None
    try:
        _check_owner(path, descriptor)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _no_folder(path: Path, name: Path | str, dir_fd: int | None, error: OSError) -> TaskRpcError:
    """Return why a private folder could not be opened."""
    try:
        found = os.stat(name, dir_fd=dir_fd, follow_symlinks=False)
    except OSError:
        return TaskRpcError(f"cannot make the folder {path}: {error.strerror}")
    if not stat.S_ISDIR(found.st_mode):
        return _not_a_folder(path)
    if not is_this_user(found.st_uid):
        return _not_ours(path)
    return TaskRpcError(f"cannot open the folder {path}: {error.strerror}")


def _not_a_folder(path: Path) -> TaskRpcError:
    return TaskRpcError(f"{path}: expected a folder of this user's, found a link or a file")


def _not_ours(path: Path) -> TaskRpcError:
    return TaskRpcError(f"{path}: expected a folder of this user's, it belongs to another user")


def _check_owner(path: Path, descriptor: int) -> None:
    found = os.fstat(descriptor)
    if not is_this_user(found.st_uid):
        raise _not_ours(path)
    if sys.platform != "win32" and found.st_mode & 0o077:
        os.fchmod(descriptor, 0o700)


def open_checked_dir(path: Path) -> int:
    """Create a folder that only this user can enter, or check an existing one without changing it.

    Returns a descriptor. Not on Windows. Raises TaskRpcError with the remedy, or OSError.
    """
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        descriptor = os.open(path, _FOLDER_FLAGS)
    except OSError as error:
        if error.errno not in (errno.ENOTDIR, errno.ELOOP, errno.EACCES):
            raise
        raise TaskRpcError(f"{path}: expected a folder of this user's") from None
    found = os.fstat(descriptor)
    if is_this_user(found.st_uid) and not found.st_mode & 0o077:
        return descriptor
    os.close(descriptor)
    if not is_this_user(found.st_uid):
        raise TaskRpcError(f"{path}: expected a folder of this user's")
    mode = stat.S_IMODE(found.st_mode)
    raise TaskRpcError(
        f"{path}: expected a folder that only its owner can enter, its mode is {mode:04o};"
        " name a folder of its own"
    )


def is_link(found: os.stat_result) -> bool:
    """Return whether a status is that of a symbolic link, or of any reparse point of Windows."""
    attributes = getattr(found, "st_file_attributes", 0)
    return stat.S_ISLNK(found.st_mode) or bool(attributes & stat.FILE_ATTRIBUTE_REPARSE_POINT)


def is_this_user(uid: int) -> bool:
    """Return whether a user id is that of this program's user.

    Always true on Windows, where files have no user id. There, other users cannot enter the user's
    profile folder.
    """
    if sys.platform == "win32":
        return True
    else:
        return uid == os.getuid()


def is_ours_or_roots(found: os.stat_result) -> bool:
    """Return whether this program's user or root owns a file."""
    return found.st_uid == 0 or is_this_user(found.st_uid)


def open_private(path: Path | str, *, must_be_new: bool = False, dir_fd: int | None = None) -> int:
    """Open or create a file that only this user can read; returns the descriptor.

    With `dir_fd`, a folder's descriptor, the path is a name in this folder.
    """
    flags = OPEN_FLAGS | os.O_CREAT | (os.O_EXCL if must_be_new else 0)
    return os.open(path, flags, 0o600, dir_fd=dir_fd)


def check_private(descriptor: int, path: object) -> None:
    """Check that only this user, or root, can read or write a file with secrets.

    Raises TaskRpcError with the remedy.
    """
    if problem := why_not_private(descriptor, path):
        raise TaskRpcError(problem)


def why_not_private(descriptor: int, path: object, *, is_key: bool = False) -> str:
    """Return why other users can read or write a file, and the remedy; "" if they cannot.

    Root does not count. A group may read a TLS key that root owns: systems give keys to servers in
    this way.
    """
    found = os.fstat(descriptor)
    if not is_ours_or_roots(found):
        return f"{path}: expected a file of this user's, it belongs to another user"
    readable = found.st_mode & (0o037 if is_key and found.st_uid == 0 else 0o077)
    if sys.platform != "win32" and readable:
        mode = stat.S_IMODE(found.st_mode)
        return (
            f"{path}: expected a file that only its owner can read, its mode is {mode:04o};"
            f" do `chmod 600 {path}`"
        )
    return ""


def is_writable_by_all(folder: Path) -> bool:
    """Return whether every user of the machine may create files in a folder; False if unknown."""
    try:  # Windows has no such mode; there, a user's folders are closed to others by default
        return sys.platform != "win32" and bool(os.stat(folder).st_mode & stat.S_IWOTH)
    except OSError:
        return False


def is_written_by_us_only(descriptor: int) -> bool:
    """Return whether only this user or root can write a file; others may be able to read it.

    Always true on Windows, where file modes do not mention other users.
    """
    found = os.fstat(descriptor)
    return sys.platform == "win32" or (is_ours_or_roots(found) and not found.st_mode & 0o022)


def write_private(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Write a file that only this user can read; a reader sees the old or the new file, complete.

    Without `sync` it does not wait for the disk, so a failure of the machine may lose the file.
    """
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    with _folder_of(path) as folder:

        def name_of(path: Path) -> str:
            return str(path) if folder is None else path.name

        # The user that made it may be able to read it.
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name_of(new), dir_fd=folder)
        descriptor = open_private(name_of(new), must_be_new=True, dir_fd=folder)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                if sync:
                    os.fsync(file.fileno())
            os.replace(name_of(new), name_of(path), src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(name_of(new), dir_fd=folder)
            raise


@contextlib.contextmanager
def _folder_of(path: Path) -> Iterator[int | None]:
    """Open the folder of a file: all steps then take place in it, also if it is moved meanwhile.

    Yields None on Windows.
    """
    if sys.platform == "win32":
        yield None
    else:
        descriptor = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            yield descriptor
        finally:
            os.close(descriptor)


def set_mode(path: Path | str, mode: int, *, dir_fd: int | None = None) -> None:
    """Set the mode of a file or folder that is no link. Raises OSError."""
    if sys.platform == "linux":
        # The file itself is not opened: closing it would drop this process's locks of it.
        descriptor = os.open(path, os.O_PATH | os.O_NOFOLLOW, dir_fd=dir_fd)
        try:
            if stat.S_ISLNK(os.fstat(descriptor).st_mode):
                raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
            os.chmod(f"/proc/self/fd/{descriptor}", mode)
        finally:
            os.close(descriptor)
    elif sys.platform == "win32":
        os.chmod(path, mode)
    else:
        os.chmod(path, mode, dir_fd=dir_fd, follow_symlinks=False)
