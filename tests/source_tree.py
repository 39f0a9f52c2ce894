"""The modules of the source tree and what they import, read from their text."""

from __future__ import annotations

import ast
import functools
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ("srvgen", "taskrpc")
CONTRACT = tomllib.loads(Path(__file__).with_name("contract.toml").read_text(encoding="utf-8"))
"""The rules of imports."""


class Import(NamedTuple):
    """One name that a module imports."""

    module: str
    """The module that has the name, or that is the name: `taskrpc.core.names`."""
    name: str
    """The name in the module; "" if the module itself is imported."""


def source_files() -> Iterator[str]:
    """Yield the path of each module, without the templates of students' programs."""
    templates = tuple(CONTRACT["templates"])
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith(templates):
                yield name


def module_of(path: str) -> str:
    """Return the dotted name of the module in a file."""
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


@functools.cache
def modules() -> frozenset[str]:
    """Return the dotted names of all modules."""
    return frozenset(map(module_of, source_files()))


def imports(path: str, text: str | bytes) -> set[Import]:
    """Return what a module imports, also inside functions and for type checkers."""
    found: set[Import] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {Import(alias.name, "") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = _base(path, node)
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                is_module = whole in modules()
                found.add(Import(whole, "") if is_module else Import(base, alias.name))
    return found


def _base(path: str, node: ast.ImportFrom) -> str:
    """Return the absolute name of the module after `from`."""
    if not node.level:
        return node.module or ""
    parts = path.removesuffix(".py").split("/")[: -node.level]
    return ".".join([*parts, node.module] if node.module else parts)


@functools.cache
def homes() -> dict[str, str]:
    """Return the module of each name that users import from `taskrpc`."""
    root = "taskrpc/__init__.py"
    return {each.name: each.module for each in imports(root, (ROOT / root).read_bytes())}


@functools.cache
def graph() -> dict[str, set[str]]:
    """Return each module with the modules of this source tree that it imports.

    An import of a public name counts as one of its module: `taskrpc` imports that when it is used.
    """
    found: dict[str, set[str]] = {}
    for path in source_files():
        names = imports(path, (ROOT / path).read_bytes())
        used = {homes().get(name, base) if base == "taskrpc" else base for base, name in names}
        found[module_of(path)] = used & modules()
    return found
