"""What `srvgen check SRC...` and its sisters were asked to work on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .errors import DefinitionError
from .files import KINDS, kind_of


def definition_files(source: Path) -> list[Path]:
    """The definition files that a source means, in a steady order.

    A source is a file, a package folder, a folder of packages or a workspace with `src`. Files
    whose ending is a slip of the pen (`X.srv.txt`) are among them, so that they are reported.

    Raises:
        DefinitionError: the source is not there or holds no definition.
    """
    if source.is_file():
        return [source]
    if not source.is_dir():
        raise DefinitionError("expected a file or folder, got nothing there", path=str(source))
    try:
        found = _in_packages(source) or _in_folder(source)
    except OSError as error:
        raise DefinitionError(
            f"expected a readable folder, got: {error.strerror or error}", path=str(source)
        ) from None
    if found:
        return found
    raise DefinitionError(
        "expected definitions (.msg, .srv, .action), got a folder without any", path=str(source)
    )


def search_paths(sources: Sequence[Path]) -> list[Path]:
    """Where the sources' own packages and their neighbours are found."""
    found: dict[Path, None] = {}
    for source in sources:
        folder = source.resolve()
        if folder.is_file():
            folder = folder.parent
        if folder.name in KINDS:
            folder = folder.parent
        found[folder] = None
        if _in_package(folder):
            found[folder.parent] = None
    return list(found)


def _in_packages(source: Path) -> list[Path]:
    """The files of the source as a package, else of the packages in it, else of those in `src`."""
    workspace = source / "src"
    for folders in (
        [source],
        sorted(source.iterdir()),
        sorted(workspace.iterdir()) if workspace.is_dir() else [],
    ):
        found = [path for folder in folders if folder.is_dir() for path in _in_package(folder)]
        if found:
            return found
    return []


def _in_package(folder: Path) -> list[Path]:
    return [
        path for kind in KINDS if (folder / kind).is_dir() for path in _in_folder(folder / kind)
    ]


def _in_folder(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.iterdir()) if path.is_file() and _is_meant(path)]


def _is_meant(path: Path) -> bool:
    """Whether a file is a definition or was meant to be one."""
    try:
        kind_of(path)
    except DefinitionError as error:
        return bool(error.hint)
    return not path.name.startswith(".")
