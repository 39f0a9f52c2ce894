"""Message and service classes at run time, straight from definitions, with nothing written."""

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
from typing import Any, NamedTuple
from weakref import WeakValueDictionary, finalize

import msgspec

from .. import _runtime, excepthook
from ..definitions import limits
from ..definitions.lines import split_full_text
from ..definitions.model import Definition, MessageDef
from ..definitions.names import split_type_name
from ..errors import DefinitionError, InvalidText
from ..files.dependencies import closure, full_text, joined_text
from ..files.reading import parse_definition
from ..files.search import BUNDLED, Search
from ..typehash import Hasher, Resolve, hash_of
from .render import Block, Import, Source, imports_of, render

_Stamp = tuple[Path, int, int]

_lock = threading.RLock()
_search = Search()
_loaded: dict[str, _Loaded] = {}
# A module lives as long as any of its classes, each of which has it, and so any of its messages:
# nobody can meet two classes of one definition, and a program that is handed thousands of
# definitions keeps only those that it works with.
_built: WeakValueDictionary[_Key, ModuleType] = WeakValueDictionary()
_versions = count()
_base: ModuleType = _runtime
"""The runtime module of generated modules."""


class _Key(NamedTuple):
    """What makes two modules the same, however they came here."""

    definition: str
    """Its repr: unlike the definition, it tells 0.0 and -0.0 apart, and knows nan again."""
    text: str
    nested: tuple[type, ...]


class _Loaded(NamedTuple):
    """A module, and the state of the files that it was made from."""

    module: ModuleType
    stamps: tuple[_Stamp, ...]

    def is_current(self, path: Path) -> bool:
        return self.stamps[-1][0] == path and all(_stamp(one[0]) == one for one in self.stamps)


def load(type_name: str) -> Any:
    """The class of a type: `example_interfaces/srv/AddTwoInts`, `std_msgs/msg/String`.

    Definitions are looked for as `Search` does, first in the paths of `install_import_hook`. The
    same class comes back until a file that it was made from changes; the import hook gives the
    same class too; afterwards `load` gives a new class, while modules keep the one that they
    imported. Safe to call from any thread.

    Raises:
        DefinitionError: there is no such type, or a definition is not valid.
    """
    excepthook.show_in_one_message()
    name = _search.resolve_name(type_name)
    found = getattr(module_of(str(name)), name.name, None)
    if found is None:
        _search.load(str(name))  # says what is wrong with the name
    return found


def define(type_name: str, full_text: str) -> Any:
    """The class of a type whose text is at hand: written here, or handed over by a server.

    Gives the same class as `load` where the definitions are the same. No file is looked for: what
    the text needs stands in it too, or in the packages that come with srvgen.

    Args:
        type_name: such as `example_interfaces/srv/AddTwoInts`.
        full_text: as in a .srv file; texts of nested types may follow, as in the `_DEFINITION` of
            a service's class.

    Raises:
        DefinitionError: a text is not a valid definition, or one is missing.
        TypeError: the name or the text is no `str`.
    """
    given = _Given(type_name, full_text)
    known = {one.full_name: one for one in closure(given.load(type_name), given)}
    with _lock:
        module = _Builder(known.__getitem__, given.full_text).build(known[type_name])
    return getattr(module, split_type_name(type_name).name)


def type_hash(type_name: str) -> str:
    """The RIHS01 hash of a type, by which ROS 2 tells whether two sides speak of the same.

    Raises:
        DefinitionError: there is no such type, or a definition is not valid.
    """
    name = str(_search.resolve_name(type_name))
    _search.closure(name)  # says where a nested type is missing or contains itself
    return hash_of(_search.load(name), _search.load)


def make_ros_classes() -> None:
    """Make classes for programs for ROS from now on (`rosidl_classes`).

    Existing classes do not change.
    """
    global _base
    from . import rosidl_classes  # only programs for ROS need it

    if _base is _runtime:
        _base = rosidl_classes.runtime()


def search() -> Search:
    """The search that `load`, `type_hash` and the import hook share."""
    return _search


def search_first(paths: Sequence[Path]) -> None:
    """Let `load`, `type_hash` and the import hook look into these folders before all others."""
    with _lock:
        others = [path for path in _search.paths if path not in paths]
        _search.paths = [*paths, *others]


def module_of(full_name: str) -> ModuleType:
    """The module, in no `sys.modules`, with the classes of the file that defines a type.

    Raises:
        DefinitionError: there is no such type, or a definition is not valid.
    """
    with _lock:
        name = split_type_name(full_name)
        path = _search.find(full_name)
        owner = str(name._replace(name=path.stem))
        known = _loaded.get(owner)
        if known is None or not known.is_current(path):
            known = _loaded[owner] = _load(owner)
        return known.module


def _load(owner: str) -> _Loaded:
    with _search.one_look():
        ordered = _search.closure(owner)
        needed = {one.full_name: one for one in ordered}
        stamps = tuple(_stamp(_search.find(name)) for name in needed)

        def text_of(one: Definition) -> str:
            inside = ordered if one is ordered[-1] else closure(one, _search)
            return joined_text(inside, _search)

        return _Loaded(_Builder(needed.__getitem__, text_of).build(ordered[-1]), stamps)


def _stamp(path: Path) -> _Stamp:
    try:
        status = path.stat()
    except OSError:
        return path, 0, 0
    return path, status.st_mtime_ns, status.st_size


class _Given:
    """The definitions of a full text, as a source of what one of them needs."""

    def __init__(self, type_name: str, whole: str) -> None:
        if not isinstance(type_name, str):
            raise TypeError(f"expected a type name (str), got {type_name!r}")
        if not isinstance(whole, str):
            raise TypeError(f"expected the text of {type_name} (str), got {reprlib.repr(whole)}")
        try:
            limits.check_length(whole)
        except InvalidText as mistake:
            raise DefinitionError(mistake.message, path=type_name) from None
        own_text, needed = split_full_text(whole)
        if len(needed) > limits.NESTED:
            most = f"expected at most {limits.NESTED} nested definitions, got {len(needed)}"
            raise DefinitionError(most, path=type_name)
        for one in needed:
            split_type_name(one)
        self._texts = {**needed, type_name: own_text}
        self._whole = {type_name: whole}

    def find(self, full_name: str) -> Path:
        return Path(full_name)

    def text(self, full_name: str) -> str:
        if full_name not in self._texts:
            self._texts[full_name] = _bundled_text(full_name)
            self._whole.clear()  # something was missing there; the complete class replaces it
        return self._texts[full_name]

    def load(self, full_name: str) -> Definition:
        package, kind, name = split_type_name(full_name)
        return parse_definition(self.text(full_name), package, kind, name, path=full_name)

    def full_text(self, definition: Definition) -> str:
        """What was given for the definition itself, in whatever order; else put together."""
        name = definition.full_name
        return self._whole.get(name) or full_text(definition, self)


def _bundled_text(full_name: str) -> str:
    package, kind, name = split_type_name(full_name)
    path = BUNDLED / package / kind / f"{name}.{kind}"
    if not path.is_file():
        raise DefinitionError(f"expected the definition of {full_name} too, got none")
    return path.read_text(encoding="utf-8")


class _Builder:
    """Makes the modules of one definition and of what it needs.

    Args:
        resolve: gives the definition of a full name; none may contain itself.
        text_of: gives the full text that a service or an action keeps.
    """

    def __init__(self, resolve: Resolve, text_of: Callable[[Definition], str]) -> None:
        self.resolve = resolve
        self.text_of = text_of
        self._hasher = Hasher(resolve)
        self._modules: dict[str, ModuleType] = {}

    def build(self, definition: Definition) -> ModuleType:
        """The module of a definition; each is built once, by however many ways it is needed."""
        name = definition.full_name
        if name not in self._modules:
            self._modules[name] = self._built(definition)
        return self._modules[name]

    def _built(self, definition: Definition) -> ModuleType:
        nested = {one.alias: self._class(one) for one in imports_of(definition)}
        text = "" if isinstance(definition, MessageDef) else self.text_of(definition)
        # A type that a server handed over is the very class that a program loaded itself.
        key = _Key(repr(definition), text, tuple(nested.values()))
        module = _built.get(key)
        if module is None:
            module = _built[key] = _execute(render(definition, self._hasher, text), nested)
        return module

    def _class(self, wanted: Import) -> type:
        module = self.build(self.resolve(wanted.full_name))
        found: type = getattr(module, wanted.name)
        return found


def _execute(source: Source, nested: Mapping[str, type]) -> ModuleType:
    module = ModuleType(source.module)
    names = {
        "_builtins": builtins,
        "_math": math,
        "_msgspec": msgspec,
        "_typing": typing,
        "_runtime": _base,
    }
    # The header's imports are done here, by hand, since the modules are in no sys.modules.
    module.__dict__.update(names, **nested)
    filename = f"srvgen: {source.module} {next(_versions)}"  # another version may have been before
    lines, checks = _declarations(source)
    exec(_compiled(lines, filename), module.__dict__)
    for before, block in checks:
        cls = module.__dict__[block.name]
        cls._check = _late_check(cls, block, before, filename)
    for made in list(vars(module).values()):
        if isinstance(made, type) and made.__module__ == source.module:
            made.__reduce__ = _reduce  # type: ignore[method-assign, assignment]
            made._MODULE = module  # type: ignore[attr-defined]
    # Asked for only where a traceback is shown.
    linecache.cache[filename] = (lambda: source.text,)
    finalize(module, linecache.cache.pop, filename, None).atexit = False
    return module


def _compiled(lines: Sequence[str], filename: str) -> CodeType:
    return compile("\n".join(lines), filename, "exec", dont_inherit=True)


def _declarations(source: Source) -> tuple[list[str], list[tuple[int, Block]]]:
    """The source with blank lines for its header and checks, and where each check begins."""
    lines = [""] * (source.header.count("\n") + 2)
    checks = []
    for block in source.blocks:
        lines += block.lines
        if block.check:
            checks.append((len(lines), block))
            lines += [""] * (len(block.check) + 1)
        lines += ["", ""]
    return lines, checks


def _late_check(cls: Any, block: Block, before: int, filename: str) -> Callable[[Any], None]:
    """What compiles a class's own `_check` when a message is first checked, and puts it in place.

    Checks are half of a class's code, and of most loaded classes no message is ever sent.
    """

    def _check(self: Any) -> None:
        lines = [*[""] * before, f"class {block.name}:", *cls._check_lines(block.check)]
        made: dict[str, type] = {}
        exec(_compiled(lines, filename), cls._MODULE.__dict__, made)
        cls._check = vars(made[block.name])["_check"]
        cls._check(self)

    return _check


def _reduce(message: _runtime.Message) -> tuple[object, ...]:
    # Another process has no module to find the class in, but it can load it as this one did.
    fields = message.__struct_fields__
    values = {name: getattr(message, name) for name in fields}
    return _restore, (message._TYPE, message._HASH, values)


def _restore(type_name: str, pickled_hash: str, values: dict[str, Any]) -> Any:
    cls = load(type_name)
    if pickled_hash != cls._HASH:
        pickled = f"expected the definition that a pickled {type_name} was made from"
        raise DefinitionError(f"{pickled} ({pickled_hash}), got another one ({cls._HASH})")
    return cls(**values)
