"""The state of modules, of which each simulated program has its own, as each process has.

The programs of a simulation share the modules of taskrpc, which makes a run thousands of times
cheaper than new processes. What these modules remember in module variables and class variables,
such as rclpy's default context, is exchanged when another program continues.
"""

from __future__ import annotations

import collections
import functools
import itertools
import logging
import operator
import os
import sys
import weakref
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

_CONTAINERS = (
    dict,
    list,
    set,
    collections.deque,
    weakref.WeakKeyDictionary,
    weakref.WeakValueDictionary,
    weakref.WeakSet,
)
_PLAIN = (bool, int, float, type(None))
_CACHED = type(functools.cache(lambda: None))
_SHARED = ("taskrpc.simulation", "taskrpc.core.transport.codec", "taskrpc.spi")
"""Modules that have no state of a program."""
_OF_CLASSES = {
    "taskrpc.sync.loop_thread": [("LoopThread", "_instance")],
    "taskrpc.sync.node": [("Node", "_has_waited")],
    "rclpy._impl.bridge": [("Bridge", "running"), ("_Shared", "_all")],
}
"""Class variables that programs change, by module."""

Values = tuple[object, ...]
"""The values of the variables of one owner."""


class ModuleState:
    """The variables that each program has for itself; made when all modules are imported."""

    def __init__(self) -> None:
        self._owners: list[Any] = []
        """Modules' dictionaries, and classes; the variables of one stand together."""
        self._names: list[tuple[str, ...]] = []
        """The names of the variables of each owner."""
        self._getters: list[tuple[Callable[[Mapping[str, object]], Values], Mapping[str, object]]]
        """For each owner, the function that returns the values, and its argument."""
        self._getters = []
        self._first: list[list[Any]] = []
        """The values of a new program."""
        self._copy_of: dict[tuple[int, int], tuple[int, int]] = {}
        """For variables with the same object as another one, the place of the first one."""
        known: dict[int, tuple[int, int]] = {}
        for owner, names, values in _grouped():
            for index, value in enumerate(values):
                place = len(self._owners), index
                if not isinstance(value, _PLAIN) and known.setdefault(id(value), place) != place:
                    self._copy_of[place] = known[id(value)]
            self._owners.append(owner)
            self._names.append(names)
            variables = owner if type(owner) is dict else vars(owner)
            self._getters.append((_getter(names), variables))
            self._first.append([_copy(value) for value in values])

    @property
    def names(self) -> list[str]:
        """The names of all variables, for tests."""
        return [
            f"{owner.get('__name__', '')}.{name}"
            if isinstance(owner, dict)
            else f"{owner.__module__}.{owner.__qualname__}.{name}"
            for owner, names in zip(self._owners, self._names, strict=True)
            for name in names
        ]

    def new(self) -> list[Values]:
        """Return the values for a new program."""
        found = [[_copy(value) for value in values] for values in self._first]
        for (owner, index), (first, at) in self._copy_of.items():
            found[owner][index] = found[first][at]
        return list(map(tuple, found))

    def take(self) -> list[Values]:
        """Return the present values."""
        return [get(variables) for get, variables in self._getters]

    def put(self, values: list[Values]) -> None:
        """Let these be the present values."""
        for owner, names, own in zip(self._owners, self._names, values, strict=True):
            if type(owner) is dict:
                owner.update(zip(names, own, strict=True))
            else:
                for name, value in zip(names, own, strict=True):
                    if owner.__dict__[name] is not value:
                        setattr(owner, name, value)


def _getter(names: tuple[str, ...]) -> Callable[[Mapping[str, object]], Values]:
    """Return a function that returns the values of these names; it runs often."""
    if len(names) > 1:
        return operator.itemgetter(*names)
    (name,) = names
    return lambda variables: (variables[name],)


def _grouped() -> Iterator[tuple[Any, tuple[str, ...], list[Any]]]:
    """Yield each owner of variables, and their names and values."""
    for _, group in itertools.groupby(_variables(), key=lambda each: id(each[0])):
        variables = list(group)
        yield variables[0][0], tuple(each[1] for each in variables), [each[2] for each in variables]


def _variables() -> Iterator[tuple[Any, str, Any]]:
    """Yield the owner, the name and the value of each variable."""
    home = str(Path(__file__).parents[2])
    for module_name, module in sorted(sys.modules.items()):
        own = vars(module) if isinstance(module, ModuleType) else {}
        if not str(own.get("__file__")).startswith(home) or module_name.startswith(_SHARED):
            continue
        if own["__name__"] != module_name:
            continue  # another name of the same module
        for name, value in sorted(own.items()):
            if _is_state(name, value):
                yield own, name, value
        for class_name, name in _OF_CLASSES.get(module_name, ()):
            yield own[class_name], name, vars(own[class_name])[name]
    root = logging.getLogger()
    yield vars(root), "handlers", root.handlers
    yield vars(root), "level", root.level
    yield vars(root.manager), "loggerDict", root.manager.loggerDict
    data = vars(os.environ)["_data"]
    yield vars(os.environ), "_data", data


def _is_state(name: str, value: object) -> bool:
    """Whether a variable is one that programs change: its name has no capitals."""
    if name.startswith("__") or name != name.lower():
        return False
    return type(value) in _CONTAINERS or type(value) in _PLAIN or _runs_once(value)


def _runs_once(value: object) -> bool:
    """Whether a value is a function that runs once in each process: cached, without arguments."""
    code = getattr(value.__wrapped__, "__code__", None) if type(value) is _CACHED else None
    return code is not None and code.co_argcount == 0


def _copy(value: Any) -> Any:
    """Return what another program gets in the place of a value."""
    if isinstance(value, _PLAIN):
        return value
    if type(value) is _CACHED:
        return functools.cache(value.__wrapped__)
    return value.copy() if type(value) in _CONTAINERS else value
