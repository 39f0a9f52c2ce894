"""What programs import: found in their text, so that it is imported before the first run."""

from __future__ import annotations

import ast
import contextlib
import importlib
from collections.abc import Iterable
from pathlib import Path


def import_for(files: Iterable[Path]) -> None:
    """Import what these programs import, also in the modules beside them.

    What cannot be imported is left out: the program shall get the error.
    """
    for name in imported(files):
        with contextlib.suppress(Exception):
            importlib.import_module(name)


def imported(files: Iterable[Path]) -> list[str]:
    """Return the modules that programs import, without those beside them."""
    found: dict[str, None] = {}
    waiting, seen = list(files), set[Path]()
    while waiting:
        file = waiting.pop()
        if file in seen:
            continue
        seen.add(file)
        try:
            tree = ast.parse(file.read_bytes())
        except (OSError, SyntaxError, ValueError):
            continue
        for name in _names(tree):
            beside = file.parent.joinpath(*name.split("."))
            own = [
                each
                for each in (beside.with_suffix(".py"), beside / "__init__.py")
                if each.is_file()
            ]
            waiting += own
            if not own:
                found[name] = None
    return list(found)


def _names(tree: ast.Module) -> Iterable[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module
