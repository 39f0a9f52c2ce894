"""The import hook: `from my_robot_interfaces.srv import RobotTask` reads the .srv file."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, NamespaceLoader
from pathlib import Path
from types import FrameType, ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from .. import excepthook
from ..definitions.names import did_you_mean, is_one_typo, is_package_name, names_in_folder
from ..errors import DefinitionError
from ..files.reading import KINDS
from .loader import module_of, search, search_first
from .render_expressions import module_name

if TYPE_CHECKING:
    from importlib.abc import Loader, MetaPathFinder
    from importlib.resources.abc import TraversableResources

    from ..definitions.model import Kind
else:  # importing them would load importlib.resources: a tenth of the start of a program
    Loader = MetaPathFinder = object

_TOO_SHORT_TO_SUGGEST = 4
"""Names of at most so many letters are similar to too many others."""


def install_import_hook(*paths: Path | str) -> None:
    """Make interface packages importable from their definitions.

    Afterwards `from my_robot_interfaces.srv import RobotTask` works if
    `my_robot_interfaces/srv/RobotTask.srv` can be found. Packages that were generated or installed
    as Python are imported as usual. A second call only adds paths.

    An imported class is the same as that of `load` until its file changes. Then modules keep the
    class that they have imported, but `load` returns a new one: restart the program to have one
    class everywhere.

    Args:
        paths: package folders, folders of packages or workspaces to search first; `load` and
            `type_hash` use them too.
    """
    excepthook.show_in_one_message()
    search_first([Path(path).resolve() for path in paths])
    if _finder not in sys.meta_path:
        # First: for Python's own finder a folder `my_robot_interfaces/srv` beside the script is an
        # empty namespace package, which would hide the definitions.
        sys.meta_path.insert(0, _finder)
        sys.meta_path.append(_suggestion_finder)


def uninstall_import_hook() -> None:
    """Remove the hook, its paths and the modules that it has imported."""
    if _finder in sys.meta_path:
        sys.meta_path.remove(_finder)
        sys.meta_path.remove(_suggestion_finder)
    search().paths.clear()
    for name in [one for one in sys.modules if _is_from_hook(one)]:
        del sys.modules[name]


class _InterfaceFinder(MetaPathFinder):
    """Finds packages of definitions that are not importable as Python."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, *rest = fullname.split(".")
        if package in sys.stdlib_module_names or not is_package_name(package):
            return None
        match rest:
            case []:
                return self._package(package)
            case ["msg" | "srv" | "action" as kind]:
                return self._folder(fullname, path, package, kind)
            case [kind, module] if kind in KINDS and _is_from_hook(f"{package}.{kind}"):
                return self._module(fullname, path, package, kind, module)
        return None

    def _package(self, package: str) -> ModuleSpec | None:
        if not search().has_package(package):
            return None
        real = self._python_spec(package, None)
        if _is_python(real):
            return None
        return _spec(package, _PackageLoader(), real)

    def _folder(
        self, fullname: str, path: Sequence[str] | None, package: str, kind: Kind
    ) -> ModuleSpec | None:
        real = self._python_spec(fullname, path)
        if _is_python(real):
            return None
        names = _names(package, kind)
        return _spec(fullname, _FolderLoader(kind, names), real) if names else None

    def _module(
        self, fullname: str, path: Sequence[str] | None, package: str, kind: str, module: str
    ) -> ModuleSpec | None:
        for name in _names(package, kind):
            if module_name(name) == module:
                return ModuleSpec(fullname, _ModuleLoader(f"{package}/{kind}/{name}"))
        is_name = module and not module.startswith("_")  # "" with __import__(folder, fromlist=[""])
        if not is_name or not is_importing() or self._python_spec(fullname, path) is not None:
            return None
        if module in _names(package, kind):
            where = f"it is a class: from {package}.{kind} import {module}"
            raise ModuleNotFoundError(f"No module named {fullname!r}; {where}", name=fullname)
        # `from … import` calls this for a missing name and shows the ImportError unchanged.
        problem = _no_interface(f"{package}.{kind}", module, _names(package, kind))
        raise ImportError(f"cannot import name {module!r}: {problem}", name=fullname)

    def _python_spec(self, fullname: str, path: Sequence[str] | None) -> ModuleSpec | None:
        for finder in sys.meta_path:
            if finder in (self, _suggestion_finder):
                continue
            if (spec := finder.find_spec(fullname, path)) is not None:
                return spec
        return None


class _SuggestionFinder(MetaPathFinder):
    """The last finder: suggests an interface package for a name that no other finder knows."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, rest = fullname.partition(".")
        if not is_importing():
            return None
        if rest and _is_from_hook(package):
            for kind in KINDS:
                if rest in _names(package, kind):
                    where = f"write: from {package}.{kind} import {rest}"
                    raise ImportError(f"cannot import name {rest!r}; {where}", name=fullname)
            has = ", ".join(kind for kind in KINDS if _names(package, kind))
            self._refuse(fullname, f"the interface package {package} has {has}")
        elif not rest and len(package) > _TOO_SHORT_TO_SUGGEST:
            # Only one typo is accepted: other names probably mean an optional package.
            near = [one for one in search().packages() if is_one_typo(one, package)]
            if near:
                self._refuse(fullname, f"did you mean {' or '.join(near)}?")
        return None

    def _refuse(self, fullname: str, hint: str) -> NoReturn:
        raise ModuleNotFoundError(f"No module named {fullname!r}; {hint}", name=fullname)


class _InterfaceLoader(Loader):
    """The base of all loaders of the hook; `_is_from_hook` recognises modules by it."""

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """None, so that Python makes the module."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: the module is complete, or loads its attributes on demand."""


class _PackageLoader(_InterfaceLoader):
    """Makes `example_interfaces`."""

    def exec_module(self, module: ModuleType) -> None:
        """Mark the module as a package without an `__init__`, as most of them are."""
        module.__file__ = None

    def get_resource_reader(self, fullname: str) -> TraversableResources | None:
        """What `importlib.resources` reads in the package's folders; None if it has none."""
        folders = list(sys.modules[fullname].__path__)
        return _resource_reader(folders) if folders else None


def _resource_reader(folders: list[str]) -> TraversableResources:
    """Reads the files of all folders as those of one, as Python does for namespace packages."""
    # Few programs need it, and importlib.resources is slow to import.
    from importlib.resources.abc import Traversable, TraversableResources
    from importlib.resources.readers import MultiplexedPath

    class FolderReader(TraversableResources):
        def files(self) -> Traversable:
            return MultiplexedPath(*map(Path, folders))

    return FolderReader()


class _FolderLoader(_PackageLoader):
    """Makes `example_interfaces.srv`, whose classes are loaded on demand."""

    def __init__(self, kind: Kind, names: list[str]) -> None:
        self.names = names
        # The interface that defines each exported class: AddTwoInts for AddTwoInts_Request.
        self.interface_of = {one: name for name in names for one in names_in_folder(kind, name)}

    def exec_module(self, module: ModuleType) -> None:
        """Load attributes from the definitions on demand."""
        super().exec_module(module)
        folder = module.__name__

        def get(attribute: str) -> Any:
            if attribute not in self.interface_of:
                raise AttributeError(_no_interface(folder, attribute, self.names))
            defining = import_module(f"{folder}.{module_name(self.interface_of[attribute])}")
            found = getattr(defining, attribute)
            setattr(module, attribute, found)
            return found

        names = list(self.interface_of)
        module.__dict__.update(__getattr__=get, __all__=names, __dir__=lambda: names)


class _ModuleLoader(_InterfaceLoader):
    """Makes `example_interfaces.srv._add_two_ints`: the module that `load` uses."""

    def __init__(self, full_name: str) -> None:
        self.full_name = full_name

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The module of `load`, so that `load` and imports have the same class."""
        return module_of(self.full_name)


def _is_python(real: ModuleSpec | None) -> bool:
    """Whether Python can import more than folders without an `__init__`."""
    return real is not None and not isinstance(real.loader, NamespaceLoader | None)


def _spec(fullname: str, loader: Loader, real: ModuleSpec | None) -> ModuleSpec:
    spec = ModuleSpec(fullname, loader, is_package=True)
    # Python modules in the same folders stay importable, and other files readable. The list is
    # that of Python itself, which follows changes of sys.path.
    if real is not None and real.submodule_search_locations is not None:
        spec.submodule_search_locations = real.submodule_search_locations
    return spec


def is_importing() -> bool:
    """Whether the calling finder is used by an `import`, so that it may raise an error.

    `importlib.util.find_spec` only asks whether a module exists; there a finder must return None.
    """
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and "importlib._bootstrap" not in frame.f_code.co_filename:
        frame = frame.f_back
    asked = frame.f_back if frame is not None else None
    return asked is not None and asked.f_code.co_name == "_find_and_load_unlocked"


def _no_interface(folder: str, name: str, known: Sequence[str]) -> str:
    problem = f"{folder} has no interface {name!r}"
    hint = did_you_mean(name, known)
    return f"{problem}; {hint}" if hint else problem


def _names(package: str, kind: str) -> list[str]:
    try:
        return [
            name
            for _, one_kind, name in (full.split("/") for full in search().interfaces(package))
            if one_kind == kind
        ]
    except DefinitionError:
        return []


def _is_from_hook(name: str) -> bool:
    module = sys.modules.get(name)
    spec = module.__spec__ if isinstance(module, ModuleType) else None
    return isinstance(getattr(spec, "loader", None), _InterfaceLoader)


_finder = _InterfaceFinder()
_suggestion_finder = _SuggestionFinder()
