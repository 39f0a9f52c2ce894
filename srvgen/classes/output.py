"""Writes generated files to a folder, and removes generated files that have no definition."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from ..errors import DefinitionError
from ..files.reading import KINDS
from .generate import runtime_source
from .render import GENERATED

IsMissing = Callable[[str], bool]


class FolderChanges(NamedTuple):
    """The differences between the folder and the generated files, each list sorted."""

    outdated: list[Path]
    stale: list[Path]
    """Modules without a definition, in packages that have other definitions."""
    gone: list[Path]
    """The folders of packages that have no definitions left."""


def kept_types(folder: Path, is_gone: IsMissing) -> set[str]:
    """The full names of the types that have modules in a folder and still have definitions."""
    made = (_made_from(path) for kind in KINDS for path in folder.glob(f"*/{kind}/_*.py"))
    return {name for name in made if name and not is_gone(name)}


def write_tree(
    files: Mapping[str, str], folder: Path, is_missing: IsMissing, *, check: bool
) -> FolderChanges:
    """Write generated files, and delete generated files that no longer have a definition.

    The folder of a package without definitions is deleted if all its files were generated.

    Args:
        files: texts by relative path.
        folder: the folder to write to.
        is_missing: whether the definition of this full name does not exist any more.
        check: only report the differences, and write nothing.

    Returns:
        The differences before writing.

    Raises:
        DefinitionError: the folder cannot be written.
    """
    try:
        changed = {path: text for path, text in files.items() if _differs(folder / path, text)}
        packages = (
            [one for one in sorted(folder.iterdir()) if one.is_dir()] if folder.is_dir() else []
        )
        needed = {path.split("/")[0] for path in files}
        gone = [one for one in packages if one.name not in needed and _is_gone(one, is_missing)]
        stale = [
            path
            for package in packages
            if package not in gone
            for path in _stale(package, is_missing)
            if path.relative_to(folder).as_posix() not in files
        ]
        if not check:
            _write(changed, folder)
            for path in (*stale, *(one for package in gone for one in _stale(package, is_missing))):
                path.unlink()
            for package in filter(_is_generated, gone):
                shutil.rmtree(package)
    except OSError as error:
        raise DefinitionError(
            f"expected a folder to write to, got: {error.strerror or error}",
            path=str(error.filename or folder),
        ) from None
    return FolderChanges([folder / path for path in sorted(changed)], stale, gone)


def _differs(path: Path, text: str) -> bool:
    return not path.is_file() or path.read_bytes() != text.encode()


def _write(files: Mapping[str, str], folder: Path) -> None:
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(text.encode())


def _is_gone(package: Path, is_missing: IsMissing) -> bool:
    """Whether a folder has generated modules, and none of them has a definition."""
    made = [_made_from(path) for kind in KINDS for path in _modules(package / kind)]
    names = [name for name in made if name]
    return bool(names) and all(map(is_missing, names))


def _stale(package: Path, is_missing: IsMissing) -> Iterator[Path]:
    """The modules of a generated package that no longer have a definition."""
    for kind in KINDS:
        made = {path: _made_from(path) for path in _modules(package / kind)}
        gone = [path for path, name in made.items() if name and is_missing(name)]
        yield from gone
        if gone and not [path for path in made if path not in gone and path.stem != "__init__"]:
            # `__init__` has nothing left to export.
            yield from (path for path in made if path.stem == "__init__")


def _modules(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.glob("_*.py*")) if path.suffix in (".py", ".pyi")]


def _is_generated(package: Path) -> bool:
    """Whether srvgen has generated every file in a folder, apart from `__pycache__`."""
    first_of_runtime = runtime_source().partition("\n")[0]

    def is_ours(path: Path) -> bool:
        if path.is_symlink():
            return False
        if path.is_dir() or path.match("__pycache__/*.pyc"):
            return True
        if path.name == "py.typed":
            return not path.stat().st_size
        first = _first_line(path).rstrip()
        return first == first_of_runtime or (first.startswith('"""') and GENERATED in first)

    return is_ours(package) and all(map(is_ours, package.rglob("*")))


def _made_from(path: Path) -> str:
    """The full name of the type that a module was generated for, or ""."""
    found = re.match(rf'"""(\w+/\w+/\w+), {re.escape(GENERATED)}', _first_line(path))
    return found[1] if found else ""


def _first_line(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return file.readline(1000).decode(errors="replace")
    except OSError:  # a folder or a broken link, which srvgen has not generated
        return ""
