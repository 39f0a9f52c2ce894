"""Takes a submission: copies a folder or a ZIP file of another person, with limits.

Links, devices and names that lead out of the folder are left out. What is too large, or has too
many files, is refused.
"""

from __future__ import annotations

import errno
import itertools
import os
import secrets
import shutil
import stat
import sys
import time
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import BinaryIO

import msgspec

from taskrpc.course.labs.starter import RECORD, read_record
from taskrpc.errors import TaskRpcError
from taskrpc.spi import private_files

LARGEST = 20 * 2**20
"""Most bytes of a submission."""
MOST_FILES = 500
_DEEPEST = 8
_IGNORED = ("__pycache__", "__MACOSX", "node_modules")
_CHUNK = 2**16
_SHOWN = 60
_ATTEMPTS = 20
_PAUSE = 0.05
"""Seconds between two attempts to remove a folder."""


class _Copy(msgspec.Struct):
    """A copy in the making."""

    target: Path
    size: int = 0
    count: int = 0
    left_out: list[str] = []

    def add(self, parts: tuple[str, ...], data: BinaryIO) -> None:
        """Copy one file. Raises TaskRpcError if the submission becomes too large."""
        self.count += 1
        if self.count > MOST_FILES:
            raise TaskRpcError(
                f"expected a submission of at most {MOST_FILES} files, got more:"
                " keep the files of the lab in a folder of their own"
            )
        path = self.target.joinpath(*parts)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            output = path.open("xb")
        except (OSError, ValueError):  # a name that this system does not have, or has already
            self.leave_out(parts, "its name")
            return
        with output:
            while chunk := data.read(_CHUNK):
                self.size += len(chunk)
                if self.size > LARGEST:
                    raise _too_large()
                output.write(chunk)

    def leave_out(self, parts: Iterable[str], reason: str) -> None:
        """Note that a file is not copied."""
        if len(self.left_out) < 3:
            name = "/".join(parts).encode(errors="backslashreplace").decode()
            self.left_out.append(f"left out {name[:_SHOWN]} ({reason})")


def take(source: Path, target: Path) -> list[str]:
    """Copy a submission into a new folder; returns what was left out, and why.

    Raises TaskRpcError if it is too large, damaged or not there.
    """
    target.mkdir()
    copy = _Copy(target)
    try:
        if source.is_dir():
            _take_folder(source, copy)
        elif source.suffix.lower() == ".zip" and (source.is_file() or not source.exists()):
            _take_zip(source, copy)
        else:
            raise TaskRpcError(f"expected a folder or a .zip file with a submission, got {source}")
    except OSError as error:
        raise TaskRpcError(f"cannot read {error.filename or source}: {error.strerror}") from None
    if sys.platform != "win32":
        # Also readable by the user of a sandbox; the folder that contains `target` is private.
        for path in (target, *target.rglob("*")):
            path.chmod(0o755 if path.is_dir() else 0o644)
    return copy.left_out


def find_lab(folder: Path, wanted: int | None) -> Path:
    """Return the wanted one of the labs in a submission, or all of a submission with one lab.

    Raises TaskRpcError if there are several labs, and not exactly one of them is wanted.
    """
    candidates = sorted(each.parent for each in folder.rglob(RECORD))
    if len(candidates) < 2 or folder in candidates:
        return folder
    records = [(candidate, read_record(candidate)) for candidate in candidates]
    labs = [(record[0], candidate) for candidate, record in records if record]
    found = [candidate for number, candidate in labs if number == wanted]
    if len(found) == 1:
        return found[0]
    names = ", ".join(
        f"lab {number} in {candidate.relative_to(folder).as_posix()}" for number, candidate in labs
    )
    what = "a lab" if wanted is None else f"lab {wanted}"
    raise TaskRpcError(
        f"expected one folder of {what}, got {names}: name the lab, such as `taskrpc lab check 1`,"
        " or change to its folder"
    )


def find_root(folder: Path, names: Iterable[str]) -> Path:
    """Return the folder in which the files of a lab are: this one, or the only one that has some.

    Students often pack the folder itself, so that the files are one or two folders further down.
    """
    wanted = tuple(names)
    for level in range(3):
        candidates = [folder] if level == 0 else sorted(folder.glob("/".join("*" * level)))
        found = [
            candidate
            for candidate in candidates
            if any((candidate / name).is_file() for name in wanted)
        ]
        if found:
            return found[0] if len(found) == 1 else folder
    return folder


def remove(folder: Path) -> None:
    """Remove a folder that a program of a submission could write to, however deep it is.

    Another process may remove it, or write to it until its end, at the same time. Follows no link:
    each step goes through the descriptor of a folder. Raises OSError.
    """
    for attempts_left in reversed(range(_ATTEMPTS)):
        try:
            _remove(folder)
        except OSError:
            if os.path.lexists(folder) and not attempts_left:
                raise
        if not os.path.lexists(folder):
            break
        time.sleep(_PAUSE)


def _remove(folder: Path) -> None:
    if os.scandir not in os.supports_fd:  # Windows
        shutil.rmtree(folder)
        return
    top = _opened(str(folder), None)
    try:
        while folders := _emptied(top, top):
            for name in folders:
                private_files.set_mode(name, 0o700, dir_fd=top)
                descriptor = _opened(name, top)
                try:
                    _emptied(descriptor, top)
                finally:
                    os.close(descriptor)
                os.rmdir(name, dir_fd=top)
    finally:
        os.close(top)
    os.rmdir(folder)


def _emptied(folder: int, top: int) -> list[str]:
    """Remove the files of a folder, and move its folders to `top`; returns the names of `top`'s.

    Moved, so that nothing becomes too deep for the system.
    """
    os.chmod(folder, 0o700)
    folders = []
    with os.scandir(folder) as entries:
        found = [(entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries]
    for name, is_folder in found:
        if not is_folder:
            os.unlink(name, dir_fd=folder)
        elif folder == top:
            folders.append(name)
        else:
            private_files.set_mode(name, 0o700, dir_fd=folder)
            os.rename(name, f"{secrets.token_hex(8)} removed", src_dir_fd=folder, dst_dir_fd=top)
    return folders


def _opened(name: str, above: int | None) -> int:
    """Open a folder that is no link. Raises OSError."""
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_DIRECTORY", 0)
    return os.open(name, os.O_RDONLY | flags, dir_fd=above)


def _take_folder(source: Path, copy: _Copy) -> None:
    top: int | str = str(source)
    if os.scandir in os.supports_fd:
        top = _opened(str(source), None)
    try:
        for parts, entry, folder in _walk(top, (), copy):
            kind = entry.stat(follow_symlinks=False).st_mode
            if not stat.S_ISREG(kind):
                copy.leave_out(parts, "a link" if stat.S_ISLNK(kind) else "not a file")
                continue
            if entry.stat(follow_symlinks=False).st_size > LARGEST:
                raise _too_large()
            with _opened_file(entry, folder) as data:
                copy.add(parts, data)
    finally:
        if isinstance(top, int):
            os.close(top)


def _walk(
    folder: int | str, above: tuple[str, ...], copy: _Copy
) -> Iterator[tuple[tuple[str, ...], os.DirEntry[str], int | str]]:
    """Yield the entries below a folder that are not folders, without what a lab never needs.

    Each comes with its folder: a descriptor, so that no link is followed; a path on Windows.
    """
    with os.scandir(folder) as found:
        entries = list(itertools.islice(found, MOST_FILES + 2))
    if above and any(entry.name == "pyvenv.cfg" for entry in entries):
        return
    for number, entry in enumerate(entries):
        parts = (*above, entry.name)
        if number > MOST_FILES:
            raise TaskRpcError(
                f"expected a submission of at most {MOST_FILES} files, got more:"
                " keep the files of the lab in a folder of their own"
            )
        if entry.name.startswith(".") or entry.name in _IGNORED:
            continue
        if not entry.is_dir(follow_symlinks=False):
            yield parts, entry, folder
        elif len(parts) > _DEEPEST:
            copy.leave_out(parts, "too deep")
        elif isinstance(folder, str):
            yield from _walk(entry.path, parts, copy)
        else:
            below = _opened(entry.name, folder)
            try:
                yield from _walk(below, parts, copy)
            finally:
                os.close(below)


def _opened_file(entry: os.DirEntry[str], folder: int | str) -> BinaryIO:
    """Open a file of a folder. Raises OSError if it has become a link, or no file, meanwhile."""
    if isinstance(folder, str):
        return open(entry.path, "rb")
    # Without waiting: a pipe would keep the grader waiting for a writer.
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    descriptor = os.open(entry.name, os.O_RDONLY | flags, dir_fd=folder)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is not a file any more", entry.name)
    return open(descriptor, "rb")


def _take_zip(source: Path, copy: _Copy) -> None:
    if source.stat().st_size > LARGEST:
        raise _too_large()
    try:
        with zipfile.ZipFile(source) as archive:
            for info in archive.infolist():
                parts = PurePosixPath(info.filename.replace("\\", "/")).parts
                if info.is_dir() or any(
                    (part.startswith(".") and part != "..") or part in _IGNORED for part in parts
                ):
                    continue
                if not parts or any(part in ("..", "/") or ":" in part for part in parts):
                    copy.leave_out(parts, "its name")
                elif stat.S_ISLNK(info.external_attr >> 16):
                    copy.leave_out(parts, "a link")
                elif len(parts) > _DEEPEST:
                    copy.leave_out(parts, "too deep")
                else:
                    with archive.open(info) as data:
                        copy.add(parts, data)  # type: ignore[arg-type]
    except (
        *(zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError),
        *(UnicodeDecodeError, ValueError, OverflowError),
    ) as error:
        if isinstance(error, TaskRpcError):
            raise
        raise TaskRpcError(f"{source.name} is no readable ZIP file: {error}") from None


def _too_large() -> TaskRpcError:
    return TaskRpcError(
        f"expected a submission of at most {LARGEST // 2**20} MB, got more:"
        " keep the files of the lab in a folder of their own"
    )
