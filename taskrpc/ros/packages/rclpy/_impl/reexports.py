"""Names that a module of ROS has only because it imports them; programs use them from there."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import srvgen


def names_of(module: str, package: str, homes: dict[str, str]) -> Callable[[str], Any]:
    """Make the `__getattr__` of a module, which finds names in their `homes`.

    A home is a module, such as `.client`, or a folder of interfaces, such as `rcl_interfaces/msg`.
    A name is imported when a program first uses it.
    """
    home_of = {name: home for home, names in homes.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home = home_of[name]
        if "/" in home:
            return srvgen.load(f"{home}/{name}")
        return getattr(importlib.import_module(home, package), name)

    return find
