"""Python programs as modules of a package: what they import, and how each is started."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator

STARTER = "_scripts"
"""The module that starts the programs that have no `main` function."""


def imports(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """The full names of the imported modules, each with its statement; no relative imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module, node


def imported(tree: ast.Module) -> set[str]:
    """The top-level packages and modules that a program imports."""
    return {name.partition(".")[0] for name, _ in imports(tree)}


def is_program(tree: ast.Module) -> bool:
    """Whether running the file does more than define names for other modules."""
    return main_function(tree) is not None or any(not _only_defines(node) for node in tree.body)


def target(tree: ast.Module, package: str, name: str) -> str:
    """The `module:function` for the program's entry point."""
    main = main_function(tree)
    has_main = main is not None and not _needs_arguments(main.args)
    return f"{package}.{name}:main" if has_main else f"{package}.{STARTER}:{name}"


def starter(package: str, names: Collection[str]) -> str:
    """The text of the module `STARTER`, with one function for each of these programs."""
    functions = "".join(
        f"\n\ndef {name}():\n    runpy.run_module('{package}.{name}', run_name='__main__')\n"
        for name in sorted(names)
    )
    return f"import runpy\n{functions}"


def as_module(text: str, package: str, neighbours: Collection[str]) -> str:
    """The text of a program that imports its neighbours from the package.

    Args:
        text: the program as it runs from its folder.
        package: the name of the new package.
        neighbours: the modules beside the program.
    """
    lines = text.splitlines(keepends=True)
    statements = [node for node in ast.walk(ast.parse(text)) if isinstance(node, _Imports)]
    for node in sorted(statements, key=lambda each: each.lineno, reverse=True):
        changed = list(_changed(node, package, neighbours))
        if changed and node.end_lineno is not None and node.end_col_offset is not None:
            first, last = lines[node.lineno - 1].encode(), lines[node.end_lineno - 1].encode()
            before = first[: node.col_offset].decode()
            after = last[node.end_col_offset :].decode()
            lines[node.lineno - 1 : node.end_lineno] = [before + "; ".join(changed) + after]
    return "".join(lines)


_Imports = ast.Import | ast.ImportFrom


def _changed(node: _Imports, package: str, neighbours: Collection[str]) -> Iterator[str]:
    """The statements that replace an import of a neighbour; none for other imports."""
    if isinstance(node, ast.ImportFrom):
        if node.module in neighbours and not node.level:
            names = ", ".join(ast.unparse(alias) for alias in node.names)
            yield f"from {package}.{node.module} import {names}"
    elif any(alias.name in neighbours for alias in node.names):
        for alias in node.names:
            is_ours = alias.name in neighbours
            yield f"{f'from {package} ' if is_ours else ''}import {ast.unparse(alias)}"


def main_function(tree: ast.Module) -> ast.FunctionDef | None:
    """The program's function `main`, or None if it has none."""
    found = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    return next((node for node in found if node.name == "main"), None)


def _needs_arguments(arguments: ast.arguments) -> bool:
    positional = [*arguments.posonlyargs, *arguments.args]
    named = [default for default in arguments.kw_defaults if default is None]
    return len(positional) > len(arguments.defaults) or bool(named)


def _only_defines(node: ast.stmt) -> bool:
    kinds = (
        ast.Import,
        ast.ImportFrom,
        ast.FunctionDef,
        ast.AsyncFunctionDef,
        ast.ClassDef,
        ast.Assign,
        ast.AnnAssign,
    )
    is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return is_text or isinstance(node, kinds)
