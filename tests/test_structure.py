"""The shape of the source tree: import circles, private access between packages, folder sizes.

`structure.toml` beside this file lists the offences that are left. The list may only shrink: a new
offence fails a test, and so does an offence that is listed and no longer there.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from tests import source_tree

ROOT = source_tree.ROOT
PACKAGES = source_tree.PACKAGES
LEFT = tomllib.loads(Path(__file__).with_name("structure.toml").read_text(encoding="utf-8"))
"""The offences that are left."""

MOST_MODULES = 15
"""Most modules of a folder; `__init__` and `__main__` are not counted."""
LARGER_FOLDERS = {
    "taskrpc/ros/packages/rclpy": 60,  # one module for each module of ROS's rclpy
}

GUIDE = 3
"""Fewest sentences of a package's docstring."""

PYTHONS_NAMES = {
    *("_asdict", "_fields", "_make", "_replace"),  # documented methods of a NamedTuple
    *("_asyncio_future_blocking", "_must_cancel"),  # asyncio's protocol between task and future
}
"""Underscore names of objects that Python itself makes."""

OF_THE_API = {"actions", "sync", "testing"}
"""Packages beside `taskrpc/core/` whose tests are in `tests/core/`, as are those of `node.py`."""
PROGRAMS = "tests/ros/packages/rclpy/programs"
"""Whole ROS programs, which belong to no module."""
CONTRACT = "tests/core/transport/contract"
"""What every transport must do, whichever modules do it."""
LARGE_MODULE = 150
"""Lines from which a module has a test file of its own."""


def source_files() -> list[Path]:
    return [ROOT / path for path in source_tree.source_files()]


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def assert_only(found: set[str], listed: str, offence: str) -> None:
    """Fail for each offence that is not listed, and for each that is listed and gone."""
    known = set(LEFT[listed])
    assert sorted(found - known) == [], offence
    assert sorted(known - found) == [], f"well done: delete these from {listed} in structure.toml"


def test_new_offences_and_settled_ones_fail(monkeypatch):
    monkeypatch.setitem(LEFT, "some_list", ["listed"])
    assert_only({"listed"}, "some_list", "explanation")
    with pytest.raises(AssertionError, match="explanation"):
        assert_only({"listed", "new"}, "some_list", "explanation")
    with pytest.raises(AssertionError, match="delete these from some_list"):
        assert_only(set(), "some_list", "explanation")


# Import circles


def in_circles(graph: Mapping[str, set[str]]) -> set[str]:
    """The modules that import themselves through others."""
    return {name for name in graph if name in reached_from(graph[name], graph)}


def reached_from(start: set[str], graph: Mapping[str, set[str]]) -> set[str]:
    found: set[str] = set()
    waiting = list(start)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += graph[name]
    return found


def test_import_circles_are_found():
    graph = {"a": {"b", "d"}, "b": {"c"}, "c": {"a"}, "d": {"e"}, "e": set()}
    assert in_circles(graph) == {"a", "b", "c"}


def test_lazy_and_type_checking_imports_count():
    assert (
        "taskrpc.ros.colcon.export" in source_tree.graph()["taskrpc.cli.workspace.export"]
    )  # inside a function


def test_no_modules_import_each_other():
    assert_only(
        in_circles(source_tree.graph()),
        "in_circles",
        "these modules import each other, directly or in a circle: move what both need into a"
        " lower module, or pass it in",
    )


# Private names


class PrivateNames(ast.NodeVisitor):
    """The private names that a module declares, and those of other objects that it reads or sets.

    A name in capitals (`_TYPE`, `_HASH`) is not private: generated message classes have such names
    for all modules that handle messages.
    """

    def __init__(self) -> None:
        self.declared: set[str] = set()
        self.accessed: set[str] = set()
        self._standard: set[str] = set()
        """Names by which this module knows modules of the standard library."""

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            if alias.name.partition(".")[0] in sys.stdlib_module_names:
                self._standard.add(alias.asname or alias.name.partition(".")[0])

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        if (node.module or "").partition(".")[0] in sys.stdlib_module_names and not node.level:
            self._standard |= {alias.asname or alias.name for alias in node.names}

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self.declared.add(node.name)
        self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        self.declared.add(node.name)
        self.generic_visit(node)

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Store):
            self.declared.add(node.id)

    def visit_Assign(self, node: ast.Assign) -> None:
        if any(isinstance(each, ast.Name) and each.id == "__slots__" for each in node.targets):
            self.declared |= {
                each.value for each in ast.walk(node.value) if isinstance(each, ast.Constant)
            }
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        owner = root_name(node)
        if isinstance(node.value, ast.Name) and owner in ("self", "cls"):
            if isinstance(node.ctx, ast.Store):
                self.declared.add(node.attr)
        elif is_private(node.attr) and owner not in self._standard:
            self.accessed.add(node.attr)
        self.generic_visit(node)


def root_name(node: ast.expr) -> str:
    """`a` for `a.b.c`, "" where an expression does not begin with a name."""
    while isinstance(node, ast.Attribute):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def is_private(name: str) -> bool:
    return (
        name.startswith("_")
        and not name.startswith("__")
        and not name.isupper()
        and name not in PYTHONS_NAMES
    )


def private_names(text: str) -> PrivateNames:
    names = PrivateNames()
    names.visit(ast.parse(text))
    return names


def accesses_across_packages() -> Iterator[str]:
    """`module._name` for each private name that no module of the same folder declares."""
    modules = {path: private_names(path.read_text("utf-8")) for path in source_files()}
    declared: dict[Path, set[str]] = {}
    for path, names in modules.items():
        declared.setdefault(path.parent, set()).update(names.declared)
    for path, names in modules.items():
        module = relative(path).removesuffix(".py").replace("/", ".")
        for name in names.accessed - declared[path.parent]:
            yield f"{module} {name}"


@pytest.mark.parametrize(
    ("text", "accessed"),
    [
        ("self._own = other._private", {"_private"}),
        ("self.other._private = 1", {"_private"}),
        ("import os\nos._exit(1)", set()),
        ("message._TYPE, point._replace(x=1), other.__class__", set()),
    ],
)
def test_private_access_is_found(text, accessed):
    assert private_names(text).accessed == accessed


def test_no_module_touches_private_names_of_another_package():
    assert_only(
        set(accesses_across_packages()),
        "private_access",
        "these modules touch underscore names of another package: give that package a public"
        " method",
    )


# Folders


def module_counts() -> dict[str, int]:
    counts: dict[str, int] = {}
    for path in source_files():
        if not path.name.startswith("__"):
            folder = relative(path.parent)
            counts[folder] = counts.get(folder, 0) + 1
    return counts


def test_folders_are_small():
    found = {
        f"{folder} has {count} modules"
        for folder, count in module_counts().items()
        if count > LARGER_FOLDERS.get(folder, MOST_MODULES)
    }
    assert_only(found, "large_folders", "divide these folders, or merge small modules")


def test_folders_with_more_modules_need_them():
    counts = module_counts()
    assert [each for each in LARGER_FOLDERS if counts.get(each, 0) <= MOST_MODULES] == []


def sentences(path: Path) -> int:
    text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    return len(re.findall(r"\w\W*[.!?](?=\s|$)", text))


def short_docstrings() -> Iterator[str]:
    for path in source_files():
        if path.name == "__init__.py" and sentences(path) < GUIDE:
            yield relative(path.parent)


def test_package_docstrings_guide_a_reader():
    assert_only(
        set(short_docstrings()),
        "short_docstrings",
        "the docstring of __init__ says in three sentences what lives here, where to start"
        " reading, and what must not be here",
    )


# Tests


def mirror_of(folder: Path) -> Path:
    """The folder of the tests of a package."""
    first, *inner = folder.relative_to(ROOT).parts
    if first == "srvgen":
        return ROOT / "tests" / "srvgen" / Path(*inner)
    if not inner or inner[0] in OF_THE_API:
        return ROOT / "tests" / "core" / Path(*inner)
    return ROOT / "tests" / Path(*inner)


def misplaced_tests() -> Iterator[str]:
    """The test files whose folder or name nothing in the package has."""
    inside: dict[Path, set[str]] = {}
    for folder in {path.parent for path in source_files()}:
        names = {each.stem.lstrip("_") for each in folder.iterdir()}
        inside.setdefault(mirror_of(folder), set()).update(names)
    mirrors = {each.relative_to(ROOT / "tests").parts[0] for each in inside if each.name != "tests"}
    for path in sorted(
        one for each in mirrors for one in (ROOT / "tests" / each).rglob("test_*.py")
    ):
        if relative(path.parent) in (PROGRAMS, CONTRACT):
            continue
        subject = path.stem.removeprefix("test_")
        known = inside.get(path.parent, set())
        if not any(subject == each or subject.startswith(f"{each}_") for each in known):
            yield relative(path)


def untested_modules() -> Iterator[str]:
    """The large modules without a test file of their name."""
    for path in source_files():
        files = mirror_of(path.parent).glob("test_*.py")
        names = {each.stem.removeprefix("test_") for each in files}
        is_large = path.read_text("utf-8").count("\n") >= LARGE_MODULE
        subject = path.stem.lstrip("_")
        is_tested = any(each == subject or each.startswith(f"{subject}_") for each in names)
        if is_large and not path.name.startswith("__") and not is_tested:
            yield relative(path)


def test_tests_mirror_the_packages():
    """`test_NAME.py` or `test_NAME_ASPECT.py`, where NAME is a module or a package beside it."""
    assert_only(
        set(misplaced_tests()),
        "tests_of_several_modules",
        "name these test files after the module or package that they test",
    )


def test_large_modules_have_a_test_file_of_their_name():
    assert sorted(untested_modules()) == [], "move or write tests for these modules"
