"""Lets programs import a class from the small module that has its name in ROS.

ROS has one module for each class: `launch.actions.execute_process` has `ExecuteProcess`. Here one
module has several classes, and the names of ROS's modules lead to it.
"""

from __future__ import annotations

import re
import sys

_WORDS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


def module_name(class_name: str) -> str:
    """The name of ROS's module for a class: `ExecuteProcess` is in `execute_process`."""
    return _WORDS.sub("_", class_name).lower()


def add_module_names(package: str) -> None:
    """Make each public class of a loaded package importable from ROS's module of its name."""
    home = sys.modules[package]
    for name in home.__all__:
        if not isinstance(getattr(home, name), type):
            continue
        home_of_class = sys.modules[getattr(home, name).__module__]
        inner = module_name(name)
        # Python's import looks into sys.modules before it searches for a file.
        sys.modules.setdefault(f"{package}.{inner}", home_of_class)
        if not hasattr(home, inner):
            setattr(home, inner, home_of_class)


def add_other_name(package: str, name: str, known_as: str) -> None:
    """Make a loaded module of a package importable under another name, which it has in ROS."""
    module = sys.modules[f"{package}.{known_as}"]
    sys.modules.setdefault(f"{package}.{name}", module)
    setattr(sys.modules[package], name, module)
