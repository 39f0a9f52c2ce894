"""Takes a submission: copies a folder or a ZIP file of another person, with limits.

Links, devices and names that lead out of the folder are left out. What is too large, or has too
many files, is refused.
"""

from __future__ import annotations

import os
import stat
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from taskrpc.errors import TaskRpcError
from taskrpc.labs.starter import RECORD, read_record

LARGEST = 20 * 2**20
"""Most bytes of a submission."""
MOST_FILES = 500
_DEEPEST = 8
_IGNORED = ("__pycache__", "__MACOSX", "node_modules")
_CHUNK = 2**16
_SHOWN = 60


@dataclass
class _Copy:
    """A copy in the making."""

    target: Path
    size: int = 0
    count: int = 0
    left_out: list[str] = field(default_factory=list)

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
    return copy.left_out


def find_lab(folder: Path, wanted: int | None) -> Path:
    """Return the wanted one of the labs in a submission, or all of a submission with one lab.

    Raises TaskRpcError if there are several labs, and not exactly one of them is wanted.
    """
    places = sorted(each.parent for each in folder.rglob(RECORD))
    if len(places) < 2 or folder in places:
        return folder
    records = [(place, read_record(place)) for place in places]
    labs = [(record[0], place) for place, record in records if record]
    found = [place for number, place in labs if number == wanted]
    if len(found) == 1:
        return found[0]
    names = ", ".join(
        f"lab {number} in {place.relative_to(folder).as_posix()}" for number, place in labs
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
        places = [folder] if level == 0 else sorted(folder.glob("/".join("*" * level)))
        found = [place for place in places if any((place / name).is_file() for name in wanted)]
        if found:
            return found[0] if len(found) == 1 else folder
    return folder


def remove(folder: Path) -> None:
    """Remove a folder that a program of a submission could write to, however deep it is."""
    waiting = [folder]
    number = 0
    while waiting:
        place = waiting[-1]
        os.chmod(place, 0o700)
        folders = []
        with os.scandir(place) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
                else:
                    os.unlink(entry.path)
        if not folders:
            os.rmdir(waiting.pop())
        # Brought up, so that no path becomes too long for the system.
        for each in folders:
            number += 1
            waiting.append(folder / f"{number} removed")
            os.rename(each, waiting[-1])


def _take_folder(source: Path, copy: _Copy) -> None:
    for parts, entry in _walk(source, (), copy):
        kind = entry.stat(follow_symlinks=False).st_mode
        if not stat.S_ISREG(kind):
            copy.leave_out(parts, "a link" if stat.S_ISLNK(kind) else "not a file")
            continue
        if entry.stat().st_size > LARGEST:
            raise _too_large()
        descriptor = os.open(entry.path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
        with open(descriptor, "rb") as data:
            copy.add(parts, data)


def _walk(
    folder: Path, above: tuple[str, ...], copy: _Copy
) -> Iterator[tuple[tuple[str, ...], os.DirEntry[str]]]:
    """Yield the entries below a folder that are not folders, without what a lab never needs."""
    with os.scandir(folder) as entries:
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
                yield parts, entry
            elif len(parts) > _DEEPEST:
                copy.leave_out(parts, "too deep")
            elif not os.path.exists(os.path.join(entry.path, "pyvenv.cfg")):
                yield from _walk(Path(entry.path), parts, copy)


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
