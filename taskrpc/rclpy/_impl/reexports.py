"""Names that modules of ROS have only because they import them; programs find them there, too."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import srvgen


def names_of(module: str, package: str, homes: dict[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a module whose names are really at `homes`.

    A home is a module, as `.client`, or a folder of interfaces, as `rcl_interfaces/msg`; its names
    are imported when a program asks for one.
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
