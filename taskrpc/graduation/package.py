"""What a program's package forgets: dependencies in `package.xml`, entry points in `setup.py`."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator, Mapping
from xml.etree import ElementTree

from taskrpc.graduation.program import Finding, Program, at

_DEPENDS = ("depend", "exec_depend", "build_depend", "run_depend", "test_depend")

NO_MANIFEST = Finding(
    1,
    1,
    "there is no package.xml beside it",
    "colcon builds no package of ROS 2 from it",
    "add one, as taskrpc pkg create writes it",
)
"""What is said of a package with a `setup.py` only."""


def declared(manifest: str) -> set[str]:
    """The packages that a `package.xml` names; raises ParseError where it is not XML."""
    root = ElementTree.fromstring(manifest.encode())
    return {(each.text or "").strip() for each in root if each.tag in _DEPENDS}


def dependencies(needs: Collection[str], known: Collection[str]) -> Iterator[Finding]:
    """What a `package.xml` should name."""
    for need in sorted(set(needs) - set(known)):
        yield Finding(
            1,
            1,
            f"{need} is imported, and not named here",
            "another computer does not install it: ModuleNotFoundError",
            f"add <exec_depend>{need}</exec_depend>",
        )


def entry_point(program: Program, module: str, targets: Mapping[str, str]) -> Iterator[Finding]:
    """The entry point that a program with a `main` should have.

    Args:
        program: the program.
        module: its full name, `package.module`.
        targets: the executables of its package.
    """
    main = [
        node
        for node in program.tree.body
        if isinstance(node, ast.FunctionDef) and node.name == "main"
    ]
    if main and not any(each.partition(":")[0] == module for each in targets.values()):
        name = module.rpartition(".")[2]
        yield at(
            main[0],
            f"{module} has a main and no entry point in setup.py",
            "ros2 run does not find it",
            f"add '{name} = {module}:main' to console_scripts",
        )
