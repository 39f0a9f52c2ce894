"""The state of modules, of which each simulated program has its own, as each process has.

The programs of a simulation share the modules of taskrpc, which makes a run thousands of times
cheaper than new processes. What these modules remember in module variables and class variables,
such as rclpy's default context, is exchanged when another program continues.
"""

from __future__ import annotations

import collections
import logging
import os
import sys
import weakref
from collections.abc import Iterator
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
_SHARED = ("taskrpc.simulation", "taskrpc.core.transport.codec", "taskrpc.spi")
"""Modules that have no state of a program."""
_OF_CLASSES = {
    "taskrpc.sync.loop_thread": [("LoopThread", "_instance")],
    "taskrpc.sync.node": [("Node", "_has_waited")],
    "rclpy._impl.bridge": [("Bridge", "running"), ("_Shared", "_all")],
}
"""Class variables that programs change, by module."""


class ModuleState:
    """The variables that each program has for itself; made when all modules are imported."""

    def __init__(self) -> None:
        self._places: list[tuple[Any, str]] = []
        self._first: list[Any] = []
        """The values of a new program, in the order of `_places`."""
        self._copy_of: list[int] = []
        """For each place, the first place with the same object."""
        known: dict[int, int] = {}
        for owner, name, value in _variables():
            self._copy_of.append(known.setdefault(id(value), len(self._places)))
            self._places.append((owner, name))
            self._first.append(value if isinstance(value, _PLAIN) else value.copy())

    @property
    def names(self) -> list[str]:
        """The names of all variables, for tests."""
        return [
            f"{owner.get('__name__', '')}.{name}"
            if isinstance(owner, dict)
            else f"{owner.__module__}.{owner.__qualname__}.{name}"
            for owner, name in self._places
        ]

    def new(self) -> list[Any]:
        """Return the values for a new program."""
        values: list[Any] = []
        for index, value in enumerate(self._first):
            if isinstance(value, _PLAIN):
                values.append(value)
            elif self._copy_of[index] == index:
                values.append(value.copy())
            else:
                values.append(values[self._copy_of[index]])
        return values

    def take(self) -> list[Any]:
        """Return the present values."""
        return [
            owner[name] if type(owner) is dict else owner.__dict__[name]
            for owner, name in self._places
        ]

    def put(self, values: list[Any]) -> None:
        """Let these be the present values."""
        for (owner, name), value in zip(self._places, values, strict=True):
            if type(owner) is dict:
                owner[name] = value
            elif owner.__dict__[name] is not value:
                setattr(owner, name, value)


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
    return type(value) in _CONTAINERS or type(value) in _PLAIN
