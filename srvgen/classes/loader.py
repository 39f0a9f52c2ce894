"""Makes message and service classes at run time, without writing files."""

from __future__ import annotations

import builtins
import linecache
import math
import reprlib
import threading
import typing
from collections.abc import Callable, Mapping, Sequence
from itertools import count
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any
from weakref import WeakValueDictionary, finalize

import msgspec

from .. import _runtime, excepthook
from ..definitions import limits
from ..definitions.lines import split_full_text
from ..definitions.model import Definition, MessageDef
from ..definitions.names import split_type_name
from ..errors import DefinitionError
from ..files import archive
from ..files.dependencies import full_text, joined_text, with_dependencies
from ..files.reading import parse_definition
from ..files.search import Search, bundled_text
from ..typehash import Hasher, Resolve, hash_of
from .render import Block, Import, ModuleSource, imports_of, render

_Stamp = tuple[Path, int, int]

_lock = threading.RLock()
_search = Search()
_loaded: dict[str, _Loaded] = {}
# Each class refers to its module, so a module lives as long as a class or a message of it. So there
# is never a second class for one definition, and a program that receives thousands of definitions
# keeps only those that it uses.
_built: WeakValueDictionary[_ModuleKey, ModuleType] = WeakValueDictionary()
_versions = count()
_runtime_module: ModuleType = _runtime
"""The runtime that new modules use: `_runtime`, or that of `rosidl_classes`."""


class _ModuleKey(msgspec.Struct, frozen=True):
    """Two modules with equal keys are the same, no matter where their definitions come from."""

    definition: str
    """The repr of the definition: it differs for 0.0 and -0.0, and is equal for nan."""
    text: str
    nested: tuple[type, ...]


class _Loaded(msgspec.Struct, frozen=True):
    """A module, and the state of the files it was made from."""

    module: ModuleType
    stamps: tuple[_Stamp, ...]

    def is_current(self, path: Path) -> bool:
        return self.stamps[-1][0] == path and all(_stamp(one[0]) == one for one in self.stamps)


def load(type_name: str) -> Any:
    """The class of a type: `example_interfaces/srv/AddTwoInts`, `std_msgs/msg/String`.

    Definitions are found as by `Search`, first in the paths of `install_import_hook`. The import
    hook and every call return the same class until one of its files changes. Then `load` returns
    a new class, but modules keep the class that they have imported. Safe to call from any thread.

    Raises:
        DefinitionError: the type is not found, or a definition is not valid.
    """
    excepthook.show_in_one_message()
    name = _search.resolve_name(type_name)
    found = getattr(module_of(str(name)), name.name, None)
    if found is None:
        _search.load(str(name))  # raises DefinitionError with the reason
    return found


def define(type_name: str, full_text: str) -> Any:
    """The class of a type from its text, for example from the program or from a server.

    The class is the same as that of `load` if the definitions are equal. Nested types must be in
    the text or in the packages that come with srvgen; no other files are read.

    Args:
        type_name: such as `example_interfaces/srv/AddTwoInts`.
        full_text: as in a .srv file; the texts of nested types may follow, as in the
            `_DEFINITION` of a service class.

    Raises:
        DefinitionError: a text is not a valid definition, or a definition is missing.
        TypeError: the name or the text is not a `str`.
    """
    given = _FullTextSource(type_name, full_text)
    known = {one.full_name: one for one in with_dependencies(given.load(type_name), given)}
    with _lock:
        module = _Builder(known.__getitem__, given.full_text).build(known[type_name])
    return getattr(module, split_type_name(type_name).name)


def type_hash(type_name: str) -> str:
    """The RIHS01 hash of a type, by which ROS 2 recognises equal types.

    Raises:
        DefinitionError: the type is not found, or a definition is not valid.
    """
    name = str(_search.resolve_name(type_name))
    _search.with_dependencies(name)  # raises if a nested type is missing or contains itself
    return hash_of(_search.load(name), _search.load)


def make_ros_classes() -> None:
    """Make all further classes as programs for ROS expect them (`rosidl_classes`).

    Existing classes do not change.
    """
    global _runtime_module
    from . import rosidl_classes  # only programs for ROS need it

    if _runtime_module is _runtime:
        _runtime_module = rosidl_classes.runtime()


def search() -> Search:
    """The search that `load`, `type_hash` and the import hook share."""
    return _search


def search_first(paths: Sequence[Path]) -> None:
    """Make `load`, `type_hash` and the import hook search these folders first."""
    with _lock:
        others = [path for path in _search.paths if path not in paths]
        _search.paths = [*paths, *others]


def module_of(full_name: str) -> ModuleType:
    """The module with the classes of a type's file; it is not in `sys.modules`.

    Raises:
        DefinitionError: the type is not found, or a definition is not valid.
    """
    with _lock:
        name = split_type_name(full_name)
        path = _search.find(full_name)
        owner = str(name.renamed(path.stem))
        known = _loaded.get(owner)
        if known is None or not known.is_current(path):
            known = _loaded[owner] = _load(owner)
        return known.module


def _load(owner: str) -> _Loaded:
    with _search.cached_lookups():
        ordered = _search.with_dependencies(owner)
        needed = {one.full_name: one for one in ordered}
        stamps = tuple(_stamp(_search.find(name)) for name in needed)

        def text_of(one: Definition) -> str:
            inside = ordered if one is ordered[-1] else with_dependencies(one, _search)
            return joined_text(inside, _search)

        return _Loaded(_Builder(needed.__getitem__, text_of).build(ordered[-1]), stamps)


def _stamp(path: Path) -> _Stamp:
    try:
        status = archive.file_of(path).stat()
    except OSError:
        return path, 0, 0
    return path, status.st_mtime_ns, status.st_size


class _FullTextSource:
    """Provides the definitions of a full text, and of the bundled packages."""

    def __init__(self, type_name: str, whole: str) -> None:
        if not isinstance(type_name, str):
            raise TypeError(f"expected a type name (str), got {type_name!r}")
        if not isinstance(whole, str):
            raise TypeError(f"expected the text of {type_name} (str), got {reprlib.repr(whole)}")
        limits.check_text(whole, type_name)
        own_text, needed = split_full_text(whole)
        if len(needed) > limits.NESTED:
            most = f"expected at most {limits.NESTED} nested definitions, got {len(needed)}"
            raise DefinitionError(most, path=type_name)
        for one in needed:
            split_type_name(one)
        self._texts = {**needed, type_name: own_text}
        self._whole = {type_name: whole}  # empty once a definition was missing in the text

    def find(self, full_name: str) -> Path:
        return Path(full_name)

    def text(self, full_name: str) -> str:
        if full_name not in self._texts:
            self._texts[full_name] = _bundled_text(full_name)
            self._whole.clear()  # the text was incomplete; the class gets the completed text
        return self._texts[full_name]

    def load(self, full_name: str) -> Definition:
        package, kind, name = split_type_name(full_name)
        return parse_definition(self.text(full_name), package, kind, name, path=full_name)

    def full_text(self, definition: Definition) -> str:
        """The given text if it is complete and of this definition, otherwise a joined one."""
        name = definition.full_name
        return self._whole.get(name) or full_text(definition, self)


def _bundled_text(full_name: str) -> str:
    text = bundled_text(split_type_name(full_name))
    if text is None:
        raise DefinitionError(f"expected the definition of {full_name} in the text, got none")
    return text


class _Builder:
    """Makes the modules of one definition and of its dependencies.

    Args:
        resolve: returns the definition of a full name; none may contain itself.
        text_of: returns the full text that the class of a service or an action keeps.
    """

    def __init__(self, resolve: Resolve, text_of: Callable[[Definition], str]) -> None:
        self.resolve = resolve
        self.text_of = text_of
        self._hasher = Hasher(resolve)
        self._modules: dict[str, ModuleType] = {}  # by the full name of the definition

    def build(self, definition: Definition) -> ModuleType:
        """The module of a definition; each module is built only once."""
        name = definition.full_name
        if name not in self._modules:
            self._modules[name] = self._build_module(definition)
        return self._modules[name]

    def _build_module(self, definition: Definition) -> ModuleType:
        nested = {one.alias: self._class(one) for one in imports_of(definition)}
        text = "" if isinstance(definition, MessageDef) else self.text_of(definition)
        # A type received from a server gets the same class as one that the program has loaded.
        key = _ModuleKey(repr(definition), text, tuple(nested.values()))
        module = _built.get(key)
        if module is None:
            module = _built[key] = _make_module(render(definition, self._hasher, text), nested)
        return module

    def _class(self, wanted: Import) -> type:
        module = self.build(self.resolve(wanted.full_name))
        found: type = getattr(module, wanted.name)
        return found


def _make_module(source: ModuleSource, nested: Mapping[str, type]) -> ModuleType:
    module = ModuleType(source.module)
    names = {
        "_builtins": builtins,
        "_math": math,
        "_msgspec": msgspec,
        "_typing": typing,
        "_runtime": _runtime_module,
    }
    # The imports of the header are done here, because the modules are not in sys.modules.
    module.__dict__.update(names, **nested)
    filename = f"srvgen: {source.module} {next(_versions)}"  # an earlier version may exist
    lines, checks = _declarations(source)
    exec(_compiled(lines, filename), module.__dict__)
    for before, block in checks:
        cls = module.__dict__[block.name]
        cls._check = _lazy_check(cls, block, before, filename)
    for made in list(vars(module).values()):
        if isinstance(made, type) and made.__module__ == source.module:
            made.__reduce__ = _reduce  # type: ignore[method-assign, assignment]
            made._MODULE = module  # type: ignore[attr-defined]
    # Used only for tracebacks, so the text is joined only then.
    linecache.cache[filename] = (lambda: source.text,)
    finalize(module, linecache.cache.pop, filename, None).atexit = False
    return module


def _compiled(lines: Sequence[str], filename: str) -> CodeType:
    return compile("\n".join(lines), filename, "exec", dont_inherit=True)


def _declarations(source: ModuleSource) -> tuple[list[str], list[tuple[int, Block]]]:
    """The lines without header and checks, and the line number at which each check begins.

    Blank lines replace the header and the checks, so that tracebacks have correct line numbers.
    """
    lines = [""] * (source.header.count("\n") + 2)
    checks = []
    for block in source.blocks:
        lines += block.lines
        if block.check:
            checks.append((len(lines), block))
            lines += [""] * (len(block.check) + 1)
        lines += ["", ""]
    return lines, checks


def _lazy_check(cls: Any, block: Block, before: int, filename: str) -> Callable[[Any], None]:
    """A `_check` that compiles the real one at the first call and replaces itself.

    Checks are half of the code of a class, and most loaded classes never send a message.
    """

    def _check(self: Any) -> None:
        lines = [*[""] * before, f"class {block.name}:", *cls._check_lines(block.check)]
        made: dict[str, type] = {}
        exec(_compiled(lines, filename), cls._MODULE.__dict__, made)
        cls._check = vars(made[block.name])["_check"]
        cls._check(self)

    return _check


def _reduce(message: _runtime.Message) -> tuple[object, ...]:
    # The module is not importable in another process, but `load` works there too.
    fields = message.__struct_fields__
    values = {name: getattr(message, name) for name in fields}
    return _unpickle, (message._TYPE, message._HASH, values)


def _unpickle(type_name: str, pickled_hash: str, values: dict[str, Any]) -> Any:
    cls = load(type_name)
    if pickled_hash != cls._HASH:
        pickled = f"expected the definition of the pickled {type_name}"
        raise DefinitionError(f"{pickled} ({pickled_hash}), got another one ({cls._HASH})")
    return cls(**values)
