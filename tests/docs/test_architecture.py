"""The pages for contributors describe the source tree as it is."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from taskrpc import spi
from tests.docs.markdown import read_page
from tests.source_tree import CONTRACT

ROOT = Path(__file__).parents[2]
ARCHITECTURE = read_page(ROOT / "docs" / "explanation" / "architecture.md")
CONTRACT_PAGE = read_page(ROOT / "docs" / "explanation" / "contract.md")
CONTRIBUTING = read_page(ROOT / "CONTRIBUTING.md")


def _rows(title: str) -> list[list[str]]:
    """The cells of the table in a section of the architecture page, without its heading."""
    rows = re.findall(r"^\|(.*)\|$", ARCHITECTURE.section(title), flags=re.M)[2:]
    return [[cell.strip() for cell in row.split("|")] for row in rows]


def _packages() -> set[str]:
    roots = (ROOT / "srvgen", ROOT / "taskrpc")
    inits = [path for root in roots for path in root.rglob("__init__.py")]
    return {f"{path.parent.relative_to(ROOT).as_posix()}/" for path in inits}


def test_the_table_of_packages_has_exactly_the_packages_of_the_tree():
    named = {name.strip("`") for name, *_ in _rows("Packages")}
    assert named == _packages()


def test_the_module_to_start_with_exists_in_its_package():
    for package, _, module in _rows("Packages"):
        path = ROOT / package.strip("`") / f"{module.strip('`')}.py"
        assert path.exists(), f"{package}: there is no {path.name}"


def test_the_table_of_modules_has_exactly_the_modules_beside_packages():
    folders = ("srvgen", "taskrpc", "taskrpc/core", "taskrpc/observe")
    files = [path for folder in folders for path in (ROOT / folder).glob("*.py")]
    modules = {path.relative_to(ROOT).as_posix() for path in files}
    named = {name.strip("`") for name, *_ in _rows("Modules beside the packages")}
    assert named == {each for each in modules if not each.endswith("__init__.py")}


def test_every_path_that_a_page_for_contributors_names_exists():
    for page in (ARCHITECTURE, CONTRIBUTING):
        paths = re.findall(r"`((?:srvgen|taskrpc|tests|\.ci)/[\w./]*)`", page.prose)
        missing = [path for path in paths if not (ROOT / path).exists()]
        assert not missing, page.path.name


def test_the_page_shows_the_layers_and_districts_that_are_checked():
    [checked] = [each["order"] for each in CONTRACT["layers"] if each["of"] == "taskrpc"]
    [block] = [block.text for block in CONTRACT_PAGE.blocks if block.kind == "text"]
    shown = [line.split(" · ") for line in block.splitlines()]
    assert shown == [layer.split() for layer in checked]
    rows = re.findall(r"^\| (\w+) \|", CONTRACT_PAGE.section("The districts"), flags=re.M)
    assert rows == ["district", *CONTRACT["districts"]]


def test_the_page_lists_the_names_of_the_spi():
    named = re.findall(r"`(\w+)`", CONTRACT_PAGE.section("What the SPI has, and for whom"))
    assert sorted(set(named) - {"Observer"}) == sorted(spi.__all__)


# The walks: each step links to the function that it describes

STEPS = re.findall(r"\[`([\w.]+)`\]\(((?:srvgen|taskrpc)/[\w/]+\.py)\)", CONTRIBUTING.prose)


def _defined_in(path: Path) -> set[str]:
    """The qualified names of the classes, functions and methods of a module."""
    names = set()

    def visit(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                names.add(prefix + node.name)
                visit(node.body, f"{prefix}{node.name}.")

    visit(ast.parse(path.read_text(encoding="utf-8")).body, "")
    return names


def test_the_page_has_three_walks_with_several_steps_each():
    walks = ("A call", "A task", "A ROS callback")
    for title in walks:
        assert CONTRIBUTING.section(title).count("](taskrpc/") >= 5, title


@pytest.mark.parametrize(("function", "path"), STEPS)
def test_a_step_of_a_walk_links_to_a_function_that_exists(function, path):
    assert function in _defined_in(ROOT / path)
