"""Find definitions: in given paths, the working directory, the environment, the bundle."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from ..definitions.derived import implied_types
from ..definitions.model import Definition, Kind
from ..definitions.names import TypeName, is_package_name, split_type_name
from ..errors import DefinitionError
from .dependencies import check_ros2_types, closure, full_text, whole_error
from .reading import KINDS, read_definition, read_text, subfolders

BUNDLED = Path(__file__).parents[1] / "interfaces"
"""The packages that come with srvgen."""

_log = logging.getLogger("srvgen")
_noted: set[tuple[Path, str]] = set()


class _Looked:
    """What one look at environment and disk has shown."""

    def __init__(self) -> None:
        self.roots: list[Path] = []
        self.packages: dict[str, list[Path]] = {}
        self.interfaces: dict[str, list[str]] = {}
        self.folders: dict[str, list[Path]] = {}
        self.places: dict[TypeName, tuple[Path, TypeName] | None] = {}


class Search:
    """Finds and loads definitions by name.

    A name is looked for in this order: the given paths; the working directory (a package folder,
    a folder of packages, or a workspace with packages in `src`); the folder of the program that
    runs, likewise; every folder of `TASKRPC_INTERFACE_PATH` and `AMENT_PREFIX_PATH`; the bundled
    packages. Environment and disk are looked at anew every time; a file is parsed again only when
    it has changed.

    Args:
        paths: package folders, folders of packages or workspaces that go before all others.
    """

    def __init__(self, paths: Sequence[Path | str] = ()) -> None:
        self.paths = [Path(path) for path in paths]
        self._parsed: dict[Path, tuple[tuple[int, int], Definition]] = {}
        self._looks = threading.local()

    @property
    def _looked(self) -> _Looked | None:
        # A thread's own: two that look at once must not leave each other's look behind.
        return getattr(self._looks, "now", None)

    @_looked.setter
    def _looked(self, looked: _Looked | None) -> None:
        self._looks.now = looked

    @contextmanager
    def one_look(self) -> Iterator[None]:
        """Inside, environment and disk are looked at only once for each name."""
        outer, self._looked = self._looked, _Looked() if self._looked is None else self._looked
        try:
            yield
        finally:
            self._looked = outer

    def find(self, full_name: str) -> Path:
        """The file that defines a type; for an implied type, that of its service or action.

        Raises:
            DefinitionError: there is none; the hint names what resembles it.
        """
        return self._locate(self.resolve_name(full_name))[0]

    def is_missing(self, full_name: str) -> bool:
        """Whether there is no type of this name within reach."""
        return self._candidates(self.resolve_name(full_name)) is None

    def existing(self, text: str) -> str:
        """The full name of a type that is within reach.

        Raises:
            DefinitionError: there is none, or several of this short name.
        """
        name = self.resolve_name(text)
        self._locate(name)
        return str(name)

    def load(self, full_name: str) -> Definition:
        """The definition of a type: from a file, a section of one, or implied by one.

        Raises:
            DefinitionError: there is none, or its file is not valid.
        """
        name = self.resolve_name(full_name)
        path, owner = self._locate(name)
        definition = self._read(path, owner.package)
        if owner == name:
            return definition
        for one in implied_types(definition):
            if one.full_name == str(name):
                return one
        raise self._unknown(name)

    def text(self, full_name: str) -> str:
        """The text of the file that defines a type.

        Raises:
            DefinitionError: as `find`, or the file cannot be read.
        """
        return read_text(self.find(full_name))

    def closure(self, full_name: str) -> list[Definition]:
        """A definition and all that it needs, ordered so that each comes after what it needs.

        A service or action needs what its implied types refer to as well.

        Raises:
            DefinitionError: a type is missing or contains itself; the position is that of the
                field that refers to it. `DefinitionErrors` where there are several.
        """
        with self.one_look():
            try:
                definition = self.load(full_name)
            except DefinitionError as error:
                raise whole_error(error, self) from None
            return closure(definition, self)

    def full_text(self, full_name: str) -> str:
        """The text of a definition followed by those of all that it needs.

        `split_full_text` takes it apart again.

        Raises:
            DefinitionError: as `closure`.
        """
        with self.one_look():
            return full_text(self.load(full_name), self)

    def packages(self) -> dict[str, list[Path]]:
        """Every package within reach with its folders, those that win first."""
        if self._looked and self._looked.packages:
            return self._looked.packages
        found: dict[str, list[Path]] = {}
        for root in self._roots():
            for folder in _package_folders(root):
                folders = found.setdefault(folder.name, [])
                if folder not in folders:
                    folders.append(folder)
        packages = dict(sorted(found.items()))
        if self._looked:
            self._looked.packages = packages
        return packages

    def has_package(self, package: str) -> bool:
        """Whether a package of this name is within reach; far cheaper than `packages`."""
        return next(_folders_of(package, self._roots()), None) is not None

    def interfaces(self, package: str) -> list[str]:
        """The full names of all that a package defines, messages first.

        Raises:
            DefinitionError: no package of this name is within reach.
        """
        known = self._looked.interfaces if self._looked else {}
        if package in known:
            return known[package]
        folders = self.packages().get(package)
        if folders is None:
            raise self._no_package(package)
        known[package] = [
            f"{package}/{kind}/{name}"
            for kind in KINDS
            for name in sorted({path.stem for folder in folders for path in _files(folder, kind)})
        ]
        return known[package]

    def resolve_name(self, text: str) -> TypeName:
        """A full type name taken apart; `pkg/Name` is accepted where it means one type only.

        Raises:
            DefinitionError: the text is no type name, or means several types.
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
            raise DefinitionError(f"{text!r} may mean {' or '.join(map(str, found))}; say which")
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
        from .not_found import name_hint  # only a mistake needs it

        with self.one_look():
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
        yield BUNDLED

    def _candidates(self, name: TypeName) -> tuple[Path, TypeName] | None:
        """The file of a type or of the service or action that implies it."""
        looked = self._looked
        if looked is None:
            return self._look(name, _folders_of(name.package, self._roots()))
        if name not in looked.places:
            looked.roots = looked.roots or list(self._roots())
            if name.package not in looked.folders:
                looked.folders[name.package] = list(_folders_of(name.package, looked.roots))
            looked.places[name] = self._look(name, looked.folders[name.package])
        return looked.places[name]

    def _look(self, name: TypeName, folders: Iterable[Path]) -> tuple[Path, TypeName] | None:
        owners = [name]
        if name.kind != "msg" and "_" in name.name:
            owners.append(name._replace(name=_owner(name.name)))
            folders = list(folders)
        for owner in owners:
            local: Path | None = None
            for folder in folders:
                path = _file_of(folder, owner)
                if path is not None:
                    if local and folder.parent == BUNDLED:
                        _note_bundled(local, owner)
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
            status = path.stat()
        except OSError:  # gone since it was found: let the reader say so
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
        from .not_found import no_type

        with self.one_look():
            packages = self.packages()
            if name.package not in packages:
                return self._no_package(name.package, name)
            error = no_type(name, packages, self.interfaces)
            error.looked_in = _shown(packages[name.package])
            return error

    def _no_package(self, package: str, wanted: TypeName | None = None) -> DefinitionError:
        from .not_found import no_package

        roots = [root for root in self._roots() if root.is_dir()]
        error = no_package(package, self.packages(), roots, wanted)
        error.looked_in = _shown(roots)
        return error


def _shown(folders: Iterable[Path]) -> tuple[str, ...]:
    """Folders as people are told of them, each once; not those that Python itself fills."""
    import sysconfig  # rarely needed, and slow to load

    installed = (BUNDLED.parent, *(Path(sysconfig.get_path(one)) for one in ("scripts", "purelib")))
    shown: dict[str, None] = {}
    for folder in folders:
        if BUNDLED in (folder, folder.parent):
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
        if root.name == package and _is_package(root):
            yield root
        # Most folders lack most packages: a plain string is the cheapest way to be told so.
        if os.path.isdir(os.path.join(root, package)) and _is_package(root / package):
            yield root / package


def _package_folders(root: Path) -> Iterator[Path]:
    """The root itself where it is a package, and the packages directly in it."""
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
    """The file of a type in a package's folder, or in a subfolder of `msg`, `srv` or `action`."""
    inner, file = package / name.kind, f"{name.name}.{name.kind}"
    if _is_file(inner / file):
        return inner / file
    below = () if package.parent == BUNDLED else subfolders(inner)
    return next((folder / file for folder in below if _is_file(folder / file)), None)


def _files(package: Path, kind: Kind) -> Iterator[Path]:
    """The definitions of a kind, those in subfolders last."""
    yield from _files_in(package / kind, kind)
    for folder in subfolders(package / kind):
        yield from _files_in(folder, kind)


def _files_in(inner: Path, kind: Kind) -> Iterator[Path]:
    """The definition files in a folder, without folders and broken links of such names."""
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
    # Asked in this order, the disk is looked at for links only.
    return entry.is_file(follow_symlinks=False) or os.path.isfile(entry)


def _is_file(path: Path) -> bool:
    try:
        # Windows and macOS find addtwoints.srv for AddTwoInts.srv; a robot on Linux would not.
        return path.is_file() and path.name in os.listdir(path.parent)
    except OSError:  # a name too long for the file system, a folder that may not be read
        return False


def _owner(name: str) -> str:
    """`AddTwoInts_Request` → `AddTwoInts`; only the prefix `Sample_` may have a `_` of its own."""
    prefix = "Sample_" if name.startswith("Sample_") else ""
    return prefix + name.removeprefix(prefix).partition("_")[0]


def _note_bundled(local: Path, name: TypeName) -> None:
    """Say once a package that a bundled definition fills a gap of a local package."""
    if (local, name.package) in _noted:
        return
    _noted.add((local, name.package))
    mixed = [
        path.stem
        for kind in KINDS
        for path in _files(local, kind)
        if (twin := BUNDLED / name.package / kind / path.name).is_file()
        and twin.read_bytes().split() != path.read_bytes().split()
    ]
    _log.log(
        logging.WARNING if mixed else logging.INFO,
        "%s is not in %s: srvgen's own definition is used%s",
        name,
        local,
        f", though the package differs in {', '.join(sorted(mixed))}" if mixed else "",
    )
