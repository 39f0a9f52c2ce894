"""Finds definitions by name: in given paths, the working directory, the environment, srvgen."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Generic, TypeVar

from ..definitions.derived import derived_types
from ..definitions.model import Definition, Kind
from ..definitions.names import TypeName, is_package_name, split_type_name
from ..errors import DefinitionError
from . import archive
from .archive import ARCHIVE
from .dependencies import check_ros2_types, error_with_dependencies, full_text, with_dependencies
from .reading import KINDS, read_definition, read_text, subfolders

BUNDLED = Path(__file__).parents[1] / "interfaces"
"""The packages that come with srvgen as files; those of `archive` come with it too."""

_INCLUDED = (BUNDLED, ARCHIVE)

T = TypeVar("T")

_log = logging.getLogger("srvgen")
_logged: set[tuple[Path, str]] = set()


class _Repeatable(Generic[T]):
    """The items of an iterator, for any number of loops; reads only as far as a loop needs."""

    def __init__(self, items: Iterator[T]) -> None:
        self._items = items
        self._known: list[T] = []

    def __iter__(self) -> Iterator[T]:
        yield from self._known
        for item in self._items:
            self._known.append(item)
            yield item


class _LookupCache:
    """Results of lookups in the environment and on the disk, for one `cached_lookups` block.

    Attributes:
        types: for each name the file and the type that it defines; None if there is none.
    """

    def __init__(self) -> None:
        self.roots: list[Path] = []
        self.packages: dict[str, list[Path]] = {}
        self.interfaces: dict[str, list[str]] = {}
        self.folders: dict[str, _Repeatable[Path]] = {}
        self.types: dict[TypeName, tuple[Path, TypeName] | None] = {}


class Search:
    """Finds and loads definitions by name.

    The order of search is: the given paths; the working directory (a package folder, a folder of
    packages, or a workspace with packages in `src`); the folder of the running program, likewise;
    the folders of `TASKRPC_INTERFACE_PATH` and `AMENT_PREFIX_PATH`; the bundled packages. Every
    lookup reads the environment and the disk again; a file is parsed again only if it has changed.

    Args:
        paths: package folders, folders of packages or workspaces that are searched first.
    """

    def __init__(self, paths: Sequence[Path | str] = ()) -> None:
        self.paths = [Path(path) for path in paths]
        # For each file the time and size at which it was parsed, and the result.
        self._parsed: dict[Path, tuple[tuple[int, int], Definition]] = {}
        self._caches = threading.local()

    @property
    def _cache(self) -> _LookupCache | None:
        # Per thread: a thread must not see or replace the cache of another one.
        return getattr(self._caches, "now", None)

    @_cache.setter
    def _cache(self, cache: _LookupCache | None) -> None:
        self._caches.now = cache

    @contextmanager
    def cached_lookups(self) -> Iterator[None]:
        """Read the environment and the disk only once per name inside this block."""
        outer, self._cache = self._cache, _LookupCache() if self._cache is None else self._cache
        try:
            yield
        finally:
            self._cache = outer

    def find(self, full_name: str) -> Path:
        """The file that defines a type; for a derived type, the file of its service or action.

        Raises:
            DefinitionError: the type is not found; the hint has similar names.
        """
        return self._locate(self.resolve_name(full_name))[0]

    def is_missing(self, full_name: str) -> bool:
        """Whether no type of this name can be found."""
        return self._candidates(self.resolve_name(full_name)) is None

    def existing_name(self, text: str) -> str:
        """The full name of a type that can be found.

        Raises:
            DefinitionError: no type, or several types, have this name.
        """
        name = self.resolve_name(text)
        self._locate(name)
        return str(name)

    def load(self, full_name: str) -> Definition:
        """The definition of a type: of a whole file, of a section, or derived.

        Raises:
            DefinitionError: the type is not found, or its file is not valid.
        """
        name = self.resolve_name(full_name)
        path, owner = self._locate(name)
        definition = self._read(path, owner.package)
        if owner == name:
            return definition
        for one in derived_types(definition):
            if one.full_name == str(name):
                return one
        raise self._unknown(name)

    def text(self, full_name: str) -> str:
        """The text of the file that defines a type.

        Raises:
            DefinitionError: the type is not found, or its file cannot be read.
        """
        return read_text(self.find(full_name))

    def with_dependencies(self, full_name: str) -> list[Definition]:
        """A definition and all its dependencies; each comes after its own, the definition last.

        The dependencies of a service or action include those of its derived types.

        Raises:
            DefinitionError: a type is missing or contains itself; the position is that of the
                field that refers to it. `DefinitionErrors` if there are several.
        """
        with self.cached_lookups():
            try:
                definition = self.load(full_name)
            except DefinitionError as error:
                raise error_with_dependencies(error, self) from None
            return with_dependencies(definition, self)

    def full_text(self, full_name: str) -> str:
        """The text of a definition followed by the texts of its dependencies.

        `split_full_text` splits it again.

        Raises:
            DefinitionError: as `with_dependencies`.
        """
        with self.cached_lookups():
            return full_text(self.load(full_name), self)

    def packages(self) -> dict[str, list[Path]]:
        """Every package that can be found with its folders, in the order of search."""
        if self._cache and self._cache.packages:
            return self._cache.packages
        found: dict[str, list[Path]] = {}
        for root in self._roots():
            for folder in _package_folders(root):
                folders = found.setdefault(folder.name, [])
                if folder not in folders:
                    folders.append(folder)
        packages = dict(sorted(found.items()))
        if self._cache:
            self._cache.packages = packages
        return packages

    def has_package(self, package: str) -> bool:
        """Whether a package of this name can be found; far cheaper than `packages`."""
        return next(_folders_of(package, self._roots()), None) is not None

    def interfaces(self, package: str) -> list[str]:
        """The full names of all interfaces of a package, messages first.

        Raises:
            DefinitionError: no package of this name can be found.
        """
        known = self._cache.interfaces if self._cache else {}
        if package in known:
            return known[package]
        folders = self.packages().get(package)
        if folders is None:
            raise self._unknown_package(package)
        known[package] = [
            f"{package}/{kind}/{name}"
            for kind in KINDS
            for name in sorted({path.stem for folder in folders for path in _files(folder, kind)})
        ]
        return known[package]

    def resolve_name(self, text: str) -> TypeName:
        """Split a full type name; `pkg/Name` is accepted if it means only one type.

        Raises:
            DefinitionError: the text is not a type name, or means several types.
        """
        try:
            parts = text.split("/")
        except AttributeError:
            raise TypeError(f"expected a type name (str), got {text!r}") from None
        if len(parts) != 2 or not is_package_name(parts[0]):
            try:
                return split_type_name(text)
            except DefinitionError as error:
                error.hint = self._name_hint(text)
                raise
        package, name = parts
        full = [TypeName(package, kind, name) for kind in KINDS]
        found = [one for one in full if self._candidates(one)]
        if len(found) > 1:
            choice = " or ".join(map(str, found))
            raise DefinitionError(f"{text!r} may mean {choice}; write the full name")
        if not found:
            raise self._unknown_short(full[0], text)
        return found[0]

    def _unknown_short(self, name: TypeName, text: str) -> DefinitionError:
        error = self._unknown(name)
        if self.has_package(name.package):
            error.message = f"package {name.package!r} has no type {name.name!r}"
            error.hint = self._name_hint(text) or error.hint
        return error

    def _name_hint(self, text: str) -> str:
        from .not_found import name_hint  # only errors need it

        with self.cached_lookups():
            return name_hint(text, self.packages(), self.interfaces)

    def _roots(self) -> Iterator[Path]:
        for path in self.paths:
            yield from _workspace(path.resolve())
        with suppress(OSError):  # the working directory may have been deleted
            yield from _workspace(Path.cwd())
        if script := getattr(sys.modules.get("__main__"), "__file__", None):
            yield from _workspace(Path(script).resolve().parent)
        yield from _environment("TASKRPC_INTERFACE_PATH")
        for prefix in _environment("AMENT_PREFIX_PATH"):
            yield prefix / "share"
        yield from _INCLUDED

    def _candidates(self, name: TypeName) -> tuple[Path, TypeName] | None:
        """The file of a type, or of the service or action that it is derived from."""
        cache = self._cache
        if cache is None:
            return self._look(name, _folders_of(name.package, self._roots()))
        if name not in cache.types:
            cache.roots = cache.roots or list(self._roots())
            if name.package not in cache.folders:
                cache.folders[name.package] = _Repeatable(_folders_of(name.package, cache.roots))
            cache.types[name] = self._look(name, cache.folders[name.package])
        return cache.types[name]

    def _look(self, name: TypeName, folders: Iterable[Path]) -> tuple[Path, TypeName] | None:
        owners = [name]
        if name.kind != "msg" and "_" in name.name:
            owners.append(name.renamed(_owner(name.name)))
            folders = list(folders)
        for owner in owners:
            local: Path | None = None
            for folder in folders:
                path = _file_of(folder, owner)
                if path is not None:
                    if local and folder.parent in _INCLUDED:
                        _log_bundled(local, owner)
                    return path, owner
                local = local or folder
        return None

    def _locate(self, name: TypeName) -> tuple[Path, TypeName]:
        found = self._candidates(name)
        if found is None:
            raise self._unknown(name)
        return found

    def _read(self, path: Path, package: str) -> Definition:
        try:
            status = archive.file_of(path).stat()
        except OSError:  # deleted since it was found: `read_definition` raises the error
            return read_definition(path, package)
        stamp = (status.st_mtime_ns, status.st_size)
        known = self._parsed.get(path)
        if known and known[0] == stamp:
            return known[1]
        definition = read_definition(path, package)
        check_ros2_types(definition, path)
        self._parsed[path] = (stamp, definition)
        return definition

    def _unknown(self, name: TypeName) -> DefinitionError:
        from .not_found import unknown_type

        with self.cached_lookups():
            packages = self.packages()
            if name.package not in packages:
                return self._unknown_package(name.package, name)
            error = unknown_type(name, packages, self.interfaces)
            error.looked_in = _shown(packages[name.package])
            return error

    def _unknown_package(self, package: str, wanted: TypeName | None = None) -> DefinitionError:
        from .not_found import unknown_package

        roots = [root for root in self._roots() if root.is_dir()]
        error = unknown_package(package, self.packages(), roots, wanted)
        error.looked_in = _shown(roots)
        return error


def bundled_text(name: TypeName) -> str | None:
    """The text of a definition that comes with srvgen; None if there is none."""
    inner = Path(name.package, name.kind, f"{name.name}.{name.kind}")
    if (BUNDLED / inner).is_file():
        return (BUNDLED / inner).read_text(encoding="utf-8")
    return archive.text_of(ARCHIVE / inner)


def _shown(folders: Iterable[Path]) -> tuple[str, ...]:
    """Folders as error messages show them, each once, without the folders of installed packages."""
    import sysconfig  # rarely needed, and slow to load

    installed = (BUNDLED.parent, *(Path(sysconfig.get_path(one)) for one in ("scripts", "purelib")))
    shown: dict[str, None] = {}
    for folder in folders:
        if folder in _INCLUDED or folder.parent in _INCLUDED:
            shown["the packages of srvgen"] = None
        elif not any(folder.is_relative_to(one) for one in installed):
            shown[str(folder)] = None
    return tuple(shown)


def _workspace(path: Path) -> Iterator[Path]:
    yield path
    yield path / "src"


def _environment(variable: str) -> list[Path]:
    return [Path(part) for part in os.environ.get(variable, "").split(os.pathsep) if part]


def _folders_of(package: str, roots: Iterable[Path]) -> Iterator[Path]:
    for root in roots:
        if root == ARCHIVE:
            if archive.definitions(package):
                yield root / package
            continue
        if root.name == package and _is_package(root):
            yield root
        # Most folders do not have the package; a string path is the cheapest way to find out.
        if os.path.isdir(os.path.join(root, package)) and _is_package(root / package):
            yield root / package


def _package_folders(root: Path) -> Iterator[Path]:
    """The root itself if it is a package, and the packages directly in it."""
    if root == ARCHIVE:
        yield from (root / name for name in archive.packages())
        return
    if _is_package(root):
        yield root
    try:
        children = sorted(root.iterdir())
    except OSError:
        return
    for child in children:
        if _is_package(child):
            yield child


def _is_package(folder: Path) -> bool:
    return is_package_name(folder.name) and any(next(_files(folder, kind), None) for kind in KINDS)


def _file_of(package: Path, name: TypeName) -> Path | None:
    """The file of a type in a package, also in a subfolder of `msg`, `srv` or `action`."""
    inner, file = package / name.kind, f"{name.name}.{name.kind}"
    if package.parent == ARCHIVE:
        return inner / file if archive.text_of(inner / file) is not None else None
    if _is_file(inner / file):
        return inner / file
    below = () if package.parent == BUNDLED else subfolders(inner)
    return next((folder / file for folder in below if _is_file(folder / file)), None)


def _files(package: Path, kind: Kind) -> Iterator[Path]:
    """The definition files of a kind, those in subfolders last."""
    if package.parent == ARCHIVE:
        names = archive.definitions(package.name)
        yield from (package / name for name in names if name.startswith(f"{kind}/"))
        return
    yield from _files_in(package / kind, kind)
    for folder in subfolders(package / kind):
        yield from _files_in(folder, kind)


def _files_in(inner: Path, kind: Kind) -> Iterator[Path]:
    """The definition files in a folder, without folders and broken links."""
    try:
        entries = os.scandir(inner)
    except OSError:
        return
    with entries:
        for entry in entries:
            name = entry.name
            if name.endswith(f".{kind}") and not name.startswith(".") and _is_any_file(entry):
                yield inner / name


def _is_any_file(entry: os.DirEntry[str]) -> bool:
    # In this order only links need a system call.
    return entry.is_file(follow_symlinks=False) or os.path.isfile(entry)


def _is_file(path: Path) -> bool:
    try:
        # Windows and macOS would also open addtwoints.srv, which a robot with Linux cannot find.
        return path.is_file() and path.name in os.listdir(path.parent)
    except OSError:  # a name too long for the file system, a folder that may not be read
        return False


def _owner(name: str) -> str:
    """`AddTwoInts_Request` → `AddTwoInts`; only the prefix `Sample_` may contain a `_`."""
    prefix = "Sample_" if name.startswith("Sample_") else ""
    return prefix + name.removeprefix(prefix).partition("_")[0]


def _log_bundled(local: Path, name: TypeName) -> None:
    """Log once per package that a bundled definition is used for a type that it lacks.

    A package without actions is not incomplete: the task server loads a bundled action in every
    workspace that has the package of its services.
    """
    if (local, name.package) in _logged:
        return
    if name.kind == "action" and not any(True for _ in _files(local, "action")):
        return
    _logged.add((local, name.package))
    mixed = [
        path.stem
        for kind in KINDS
        for path in _files(local, kind)
        if (twin := bundled_text(TypeName(name.package, kind, path.stem))) is not None
        and twin.encode().split() != path.read_bytes().split()
    ]
    _log.log(
        logging.WARNING if mixed else logging.INFO,
        "%s is not in %s: srvgen's own definition is used%s",
        name,
        local,
        f", though the package differs in {', '.join(sorted(mixed))}" if mixed else "",
    )
