"""mypy and pyright accept good programs, and report each mistake of bad ones with its message.

Below a line that is wrong, a program in `programs` has what the checkers say of it, as comments
that begin with `mypy reports:` and `pyright reports:`; `…` stands for any text.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

from srvgen.classes.stubs import packages_with_dependencies, stubs
from srvgen.files.search import BUNDLED, Search
from taskrpc.ros import bundled
from tests.docs.markdown import Page, read_page
from tests.srvgen.sample_definitions import put_all

pytestmark = [pytest.mark.types, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(__file__).parent / "programs"
NAMES = sorted(path.name for path in PROGRAMS.glob("*.py"))
WITHOUT_LOAD = sorted(
    path.name for path in PROGRAMS.glob("*.py") if "srvgen.load" not in path.read_text("utf-8")
)
_EXPECTED = re.compile(r"\s*# (mypy|pyright) reports: (.*)")

Messages = dict[int, list[str]]
"""What a checker says of a file's lines."""


def _run(*command: str | Path, cwd: Path, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", *map(str, command)],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert not done.stderr, done.stderr
    return done.stdout


def _mypy(folder: Path, names: Iterable[str], *options: str) -> dict[str, Messages]:
    found: dict[str, Messages] = {}
    cache = folder.parent / "mypy_cache"  # what all programs import is read once
    command = (
        "mypy",
        "--cache-dir",
        cache,
        "--output=json",
        "--no-error-summary",
        *options,
        *names,
    )
    for line in _run(*command, cwd=folder, MYPYPATH="typings").splitlines():
        report = json.loads(line)
        if report["severity"] == "error":
            lines = found.setdefault(Path(report["file"]).name, {})
            lines.setdefault(report["line"], []).append(report["message"])
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The folder of all projects below."""
    return tmp_path_factory.mktemp("projects")


@pytest.fixture(scope="module")
def with_stubs(folder) -> Path:
    """The programs beside the folder of `srvgen stubs`."""
    shutil.copytree(PROGRAMS, project := folder / "with_stubs")
    _run("srvgen", "stubs", "my_interfaces", "std_msgs", cwd=project)
    return project


@pytest.fixture(scope="module")
def with_generated(folder) -> Path:
    """Programs beside the packages of `srvgen generate`."""
    (project := folder / "with_generated").mkdir()
    for name in WITHOUT_LOAD:
        shutil.copy(PROGRAMS / name, project)
    sources = PROGRAMS / "my_interfaces", BUNDLED / "std_msgs"
    _run("srvgen", "generate", *sources, "-o", project, cwd=project)
    return project


@pytest.fixture(scope="module")
def mypy_reports(with_stubs, with_generated) -> Mapping[str, Mapping[str, Messages]]:
    """What mypy says of these programs, by the project and the name of the program."""
    return {
        with_stubs.name: _mypy(with_stubs, NAMES, "--strict"),
        with_generated.name: _mypy(with_generated, WITHOUT_LOAD, "--strict"),
    }


@pytest.fixture(scope="module")
def pyright_reports(
    folder, with_stubs, with_generated, loads, readme, pages
) -> Mapping[str, Mapping[str, Messages]]:
    """What pyright says of the programs of all projects, by the project and the program's name.

    It runs once: most of the time of a run, it reads what all programs import.
    """
    names = {
        with_stubs: NAMES,
        with_generated: WITHOUT_LOAD,
        loads: ["loads.py"],
        readme: [path.name for path in readme.glob("*.py")],
    }
    roots = [*names, *pages]
    shared = f"{PAGES}/typings"
    environments = []
    for here in (root.relative_to(folder).as_posix() for root in roots):
        paths = [here, f"{here}/typings", *([shared] if here.startswith(f"{PAGES}/") else [])]
        environments.append({"root": here, "extraPaths": paths})
    programs = [root / name for root, each in names.items() for name in each]
    settings = {
        "executionEnvironments": environments,
        "include": [path.relative_to(folder).as_posix() for path in (*programs, *pages)],
        "exclude": ["**/typings"],
    }
    (folder / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    command = ("pyright", "--outputjson", "--pythonpath", sys.executable)
    output = _run(*command, cwd=folder, PYRIGHT_PYTHON_IGNORE_WARNINGS="1")
    found: dict[str, dict[str, Messages]] = {}
    for report in json.loads(output)["generalDiagnostics"]:
        if report["severity"] == "error":
            path = Path(report["file"]).resolve().relative_to(folder.resolve())
            lines = found.setdefault(path.parent.as_posix(), {}).setdefault(path.name, {})
            message = report["message"].replace("\N{NO-BREAK SPACE}", " ")
            lines.setdefault(report["range"]["start"]["line"] + 1, []).append(message)
    return found


@pytest.fixture(params=["mypy", "pyright"])
def checker(request) -> str:
    """The name of a checker."""
    return request.param


@pytest.fixture
def reports(request, checker) -> Mapping[str, Mapping[str, Messages]]:
    """What this checker says of the programs with stubs, and of those with generated packages."""
    return request.getfixturevalue(f"{checker}_reports")


def _expected(name: str, checker: str) -> Messages:
    expected: Messages = {}
    wrong = 0
    for number, line in enumerate((PROGRAMS / name).read_text("utf-8").splitlines(), 1):
        if (match := _EXPECTED.match(line)) is None:
            wrong = number
        elif match[1] == checker:
            expected.setdefault(wrong, []).append(match[2])
    return expected


def _matches(message: str, expected: str) -> bool:
    return re.match(".*".join(map(re.escape, expected.split("…"))), message, re.DOTALL) is not None


def _compare(found: Messages, expected: Messages) -> None:
    assert sorted(found) == sorted(expected), found
    for line, messages in found.items():
        assert len(messages) == len(expected[line]), (line, messages)
        for message, wanted in zip(messages, expected[line], strict=True):
            assert _matches(message, wanted), f"line {line}: {message}"


@pytest.mark.parametrize("name", NAMES)
def test_checkers_report_the_mistakes_of_a_program_and_nothing_else(name, checker, reports):
    assert name.startswith("bad_") == bool(_expected(name, checker))
    _compare(reports["with_stubs"].get(name, {}), _expected(name, checker))


@pytest.mark.parametrize("name", WITHOUT_LOAD)
def test_generated_packages_are_as_precise_as_stubs(name, checker, reports):
    _compare(reports["with_generated"].get(name, {}), _expected(name, checker))


LOADS = """\
import srvgen

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
total: int = AddTwoInts.Response(sum=3).sum
name: str = srvgen.load("std_msgs/String")().data
frame: str = srvgen.load("nav_msgs/msg/Odometry")().header.frame_id
srvgen.load("nav2_msgs/srv/ClearEntireCostmap").Request().anything
srvgen.load("my_" + "interfaces/srv/Greet").Request().anything
"""
MISLOADS = """\
AddTwoInts.Request(c=1)
AddTwoInts.Response().som
srvgen.load("nav_msgs/msg/Odometry")().header.frame
srvgen.load("example_interfaces/action/Fibonacci").Gaol()
"""


@pytest.fixture(scope="module")
def loads(folder) -> Path:
    """A program without stubs."""
    (project := folder / "loads").mkdir()
    (project / "loads.py").write_text(LOADS + MISLOADS, encoding="utf-8")
    return project


def test_load_of_a_bundled_type_needs_no_stubs(request, loads, checker):
    if checker == "mypy":
        found = _mypy(loads, ["loads.py"], "--strict")
    else:
        found = request.getfixturevalue("pyright_reports")[loads.name]
    first = LOADS.count("\n") + 1
    lines = found["loads.py"]
    assert sorted(lines) == list(range(first, first + MISLOADS.count("\n"))), found


_ROS = re.compile(rf"^(?:import|from) (?:{'|'.join(['rclpy', *bundled.packages()])})\b", flags=re.M)
"""An import of a package that only `taskrpc run` finds."""


def _write_programs(page: Page, folder: Path) -> list[str]:
    """Write a page's definitions and native Python programs; the programs' names."""
    names = []
    for block in page.blocks:
        is_program = block.kind == "python" and not _ROS.search(block.text)
        is_program &= Path(block.file).name != "setup.py"
        if not block.notes.keys() & {"wrong", "not run"} and (
            is_program or (block.kind in ("srv", "msg", "action") and block.file)
        ):
            path = folder / (block.file or f"line_{block.line}.py")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text + "\n", encoding="utf-8")
            names += [str(path.relative_to(folder))] if is_program else []
    return sorted(set(names))


@pytest.fixture(scope="module")
def readme(folder) -> Path:
    """README's programs as they stand, the same with mistakes, and the stubs of their service."""
    _write_programs(read_page(ROOT / "README.md"), project := folder / "readme")
    client = (project / "client.py").read_text("utf-8")
    misread = client.replace("response.greeting", "response.greting")
    wrong = client.replace('Greet.Request(name="Ada", times=2)', "Greet.Response()")
    server = (project / "server.py").read_text("utf-8").replace("    return response\n", "")
    for name, text in {"misread": misread, "wrong": wrong, "forgets": server}.items():
        (project / f"{name}.py").write_text(text, encoding="utf-8")
    _run("srvgen", "stubs", "my_interfaces", cwd=project)
    return project


def test_the_programs_of_the_readme_are_checked_as_they_stand(request, readme, checker):
    names = sorted(path.name for path in readme.glob("*.py"))
    assert {"server.py", "client.py"} < set(names)
    if checker == "mypy":
        found = _mypy(readme, names, "--check-untyped-defs")
        reported = {"misread.py", "wrong.py"}  # mypy infers no types of functions without any
    else:
        found = request.getfixturevalue("pyright_reports")[readme.name]
        reported = {"misread.py", "wrong.py", "forgets.py"}
    assert set(found) == reported, found


PAGES = "pages"
"""The folder with one project for each page."""


@pytest.fixture(scope="module")
def pages(folder) -> list[Path]:
    """The programs of all pages, with the stubs of their own definitions; one project each."""
    bundled_ones, _ = packages_with_dependencies([], Search([BUNDLED]))
    put_all(stubs(bundled_ones), folder / PAGES / "typings")
    roots = []
    for path in sorted((ROOT / "docs").rglob("*.md")):
        root = folder / PAGES / path.relative_to(ROOT / "docs").with_suffix("")
        if _write_programs(read_page(path), root):
            if own := sorted({each.parents[1].name for each in root.glob("*/*/*.*")}):
                definitions, _ = packages_with_dependencies(own, Search([root, BUNDLED]))
                put_all(stubs(definitions), root / "typings")
            roots.append(root)
    assert len(roots) > 10
    return roots


def test_the_programs_of_the_pages_have_no_mistakes_but_those_that_are_meant(pyright_reports):
    found = {each: it for each, it in pyright_reports.items() if each.startswith(f"{PAGES}/")}
    assert {name for each in found.values() for name in each} == {"mistakes.py"}, found


def test_checkers_report_the_mistakes_as_the_page_shows(tmp_path, pyright_reports):
    page = read_page(ROOT / "docs" / "how-to" / "check-types.md")
    _write_programs(page, tmp_path)
    _run("srvgen", "stubs", "my_interfaces", "std_srvs", cwd=tmp_path)
    (shown,) = [block.text for block in page.blocks if block.text.startswith("$ mypy")]
    output = _run(
        "mypy",
        "--cache-dir",
        tmp_path.parent / "mypy_cache",
        "mistakes.py",
        cwd=tmp_path,
        MYPYPATH="typings",
    )
    assert output.strip() == shown.partition("\n")[2]
    lines = {line.split(":")[1] for line in output.splitlines() if ": error:" in line}
    (found,) = pyright_reports[f"{PAGES}/how-to/check-types"].values()
    assert {str(line) for line in found} == lines


def test_mypy_checks_each_package_of_ros_under_its_name():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["mypy"]
    assert settings["packages"] == ["srvgen", "taskrpc", *sorted(bundled.packages())]
