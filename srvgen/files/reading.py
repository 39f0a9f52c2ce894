"""Reads definition files; the path gives the package, the kind and the name of the type."""

from __future__ import annotations

import codecs
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import cast, get_args

from ..definitions.model import Definition, Kind
from ..definitions.names import is_package_name, snake_case
from ..errors import DefinitionError
from ..parser import parse_action, parse_msg, parse_srv
from . import archive

KINDS: tuple[Kind, ...] = get_args(Kind)
"""The folders of a package with definitions; each name is also the suffix of its files."""

LONGEST = 4 * 2**20
"""Maximum bytes of a definition file; the largest file of ROS 2 has 50,000."""

_PARSERS = {"msg": parse_msg, "srv": parse_srv, "action": parse_action}
_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def parse_definition(
    text: str, package: str, kind: Kind, name: str, *, path: str = ""
) -> Definition:
    """Parse the text of a file of the given kind.

    Raises:
        DefinitionError: the text is not a valid definition.
    """
    return cast("Definition", _PARSERS[kind](text, package, name, path=path))


def read_definition(path: Path, package: str | None = None) -> Definition:
    """Read and parse one file.

    The file gives the name of the type, the folder above `msg`, `srv` or `action` the name of the
    package, unless `package` is given; subfolders of `msg`, `srv` and `action` do not count.

    Raises:
        DefinitionError: the file cannot be read, is not UTF-8 or is not a valid definition.
    """
    text = read_text(path)
    kind = kind_of(path)
    package = package_of(path) if package is None else package
    return parse_definition(text, package, kind, path.stem, path=str(path))


def read_text(path: Path) -> str:
    """The text of a definition file; line ends are not changed.

    Raises:
        DefinitionError: the file cannot be read or is not UTF-8.
    """
    return decode(read_data(path), str(path))


def read_data(path: Path) -> bytes:
    """The bytes of a definition file.

    Raises:
        DefinitionError: the file cannot be read.
    """
    if (packed := archive.text_of(path)) is not None:
        return packed.encode()
    try:
        # Reading a pipe would block until it has a writer; a device may be endless.
        if not stat.S_ISREG(path.stat().st_mode) and not path.is_dir():
            raise DefinitionError("expected a file, got a pipe or a device", path=str(path))
        with path.open("rb") as file:
            data = file.read(LONGEST + 1)
    except OSError as error:
        # On Windows the error for a folder is only: permission denied.
        problem = "a folder" if path.is_dir() else error.strerror or error
        raise DefinitionError(f"expected a readable file, got: {problem}", path=str(path)) from None
    if len(data) > LONGEST:
        expected = f"expected a definition of at most {LONGEST // 2**20} MiB, got a larger file"
        raise DefinitionError(expected, path=str(path))
    return data


def decode(data: bytes, path: str = "") -> str:
    """Decode the bytes of a file; the parser refuses a byte order mark of UTF-8.

    Raises:
        DefinitionError: the bytes are not UTF-8.
    """
    if data.startswith(_UTF16_MARKS) or b"\0" in data[:64]:
        raise DefinitionError(
            "expected UTF-8 text, got UTF-16 or binary data",
            path=path,
            hint='save the file as "UTF-8"',
        )
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8")
        line = before.count("\n") + 1
        raise DefinitionError(
            f"expected UTF-8 text, got the byte 0x{data[error.start]:02X}",
            path=path,
            line=line,
            column=len(before) - before.rfind("\n"),
            source_line=before.rpartition("\n")[2] + "\N{REPLACEMENT CHARACTER}",
            hint='save the file as "UTF-8"',
        ) from None


def kind_of(path: Path) -> Kind:
    """The kind of a definition file, by its suffix.

    Raises:
        DefinitionError: the suffix is not .msg, .srv or .action.
    """
    for kind in KINDS:
        if path.suffix == f".{kind}":
            return kind
    meant = meant_path(path)
    hint = ""
    if meant:
        hidden = f"; file managers may hide {path.suffix}"
        hint = f"rename the file to {meant.name}{hidden if meant.name == path.stem else ''}"
    raise DefinitionError(
        f"expected a file that ends in .msg, .srv or .action, got {path.name!r}",
        path=str(path),
        hint=hint,
    )


def meant_path(path: Path) -> Path | None:
    """The correct path of a file with a wrong extension: `X.srv` for `X.srv.txt` and `X.SRV`."""
    if Path(path.stem).suffix.removeprefix(".") in KINDS:
        return path.with_name(path.stem)
    right = path.suffix.lower()
    is_slip = right != path.suffix and right.removeprefix(".") in KINDS
    return path.with_name(path.stem + right) if is_slip else None


def kind_folder(path: Path) -> Path | None:
    """The folder `msg`, `srv` or `action` that a definition belongs to, or None.

    It is the folder of the file, or a folder above it in a package with a `package.xml`. Without
    a `package.xml`, a folder further up may be called `msg` for another reason.
    """
    inner, *above = path.resolve().parents
    if inner.name in KINDS:
        return inner
    return next(
        (each for each in above if each.name in KINDS and has_subfolders(each.parent)), None
    )


def has_subfolders(package: Path) -> bool:
    """Whether subfolders of `msg`, `srv` and `action` belong to the package too."""
    return (package / "package.xml").is_file()


def subfolders(folder: Path) -> Iterator[Path]:
    """All folders below `msg`, `srv` or `action` that may contain definitions."""
    try:
        with os.scandir(folder) as entries:
            inner = sorted(
                entry.name
                for entry in entries
                if entry.is_dir(follow_symlinks=False) and not entry.name.startswith(".")
            )
    except OSError:
        return
    for name in inner:
        if name.rpartition(".")[2] not in KINDS:  # a folder `X.srv` is a mistake, which is reported
            yield folder / name
            yield from subfolders(folder / name)


def package_of(path: Path) -> str:
    """The package of a definition file: the folder above `msg`, `srv` or `action`.

    For a file outside such a folder, the package is the name of the file's folder, made valid, so
    that the file can be checked before it is in a package.
    """
    folder = kind_folder(path)
    if folder is not None:
        return folder.parent.name
    name = snake_case(path.resolve().parent.name)
    return name if is_package_name(name) else "unnamed_package"
