"""Stubs tell editors and type checkers what the import hook and `load` give."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import srvgen
from srvgen.classes.stubs import packages_with_dependencies, stubs
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put
from tests.types.bundled_stubs import committed, expected


@pytest.fixture(autouse=True)
def my_msgs(workspace):
    put(
        "my_msgs/srv/Fetch",
        "# Fetches.\nstring what\ngeometry_msgs/Point at\n---\nbool ok # done\n",
    )
    put("my_msgs/msg/Note", "int32 LIMIT=3\nfloat64[] xs\nint32 from\n")


USER = """\
from array import array

import srvgen

srvgen.install_import_hook()
from example_interfaces.action import Fibonacci
from my_msgs.msg import Note
from my_msgs.srv import Fetch

def answer(request: Fetch.Request, response: Fetch.Response, goal: Fibonacci.Goal) -> int:
    response.ok = request.at.x > Note.LIMIT and len(request.what) > 0
    return goal.order

loaded = srvgen.load("my_msgs/srv/Fetch")
request = loaded.Request(what="ball")
answer(request, loaded.Response(), Fibonacci.Impl.SendGoalService.Request().goal)
name: str = srvgen.load("std_msgs/String")().data
Note(xs=[1, 2.5], from_=3).xs.append(4.0)
note = Note(xs=array("f", [1.0]), **{"from": 3})
note.xs = (1, 2.5)
note.xs = range(3)
note.xs[0] = 1
note.from_ += 1
first: float = note.xs[0] + sum(note.xs) + max(note.xs[1:])
numbers: list[float] = note.xs.tolist() + list(memoryview(note.xs)) + [len(note.xs)]
anything = srvgen.load("nowhere/msg/X")
srvgen.to_builtins(request)
"""
MISTAKES = """\
loaded.Request(wat="ball")
request.what = 3
Fetch.Response(ok="yes")
srvgen.load("std_msgs/msg/String")(data=1)
request.at.w
Fetch.Request("ball")
loaded.Reqest()
Note(xs="abc")
note.xs = 3
note.xs = ["a"]
word: str = note.xs[0]
note.xs[0] = "a"
note.text = "there is no such field"
from my_msgs.srv import Fetsh
"""
FIRST_MISTAKE = USER.count("\n") + 1
WRONG_LINES = [str(FIRST_MISTAKE + n) for n in range(MISTAKES.count("\n"))]


def test_all_packages_that_can_be_found_are_the_default(run):
    code, out, err = run("stubs")
    packages = len(Search().packages())
    assert (code, err) == (0, "")
    assert f"of {packages} packages to typings\n" in out
    for path in ("my_msgs/srv/_fetch.pyi", "std_msgs/msg/__init__.pyi", "srvgen/__init__.pyi"):
        assert Path("typings", path).is_file()


def test_packages_and_types_include_complete_dependencies(run):
    assert run("stubs", "my_msgs/srv/Fetch", "-o", "elsewhere")[0] == 0
    assert {one.name for one in Path("elsewhere").iterdir()} == {
        "my_msgs", "geometry_msgs", "std_msgs", "service_msgs", "builtin_interfaces", "srvgen"
    }  # fmt: skip
    assert Path("elsewhere/geometry_msgs/msg/_wrench.pyi").is_file()
    assert Path("elsewhere/my_msgs/msg/_note.pyi").is_file()


def test_stubs_of_a_missing_source_fail(run):
    assert run("stubs", "my_msg")[0] == 1
    assert run("stubs", "my_msgs/srv/Fetsh")[0] == 1
    assert not Path("typings").exists()


def test_valid_definitions_are_written_although_another_one_is_invalid(run):
    put("my_msgs/msg/Bad", "int a\n")
    code, _, err = run("stubs", "my_msgs")
    assert (code, "got 'int'" in err) == (1, True)
    assert Path("typings/my_msgs/msg/_note.pyi").is_file()


def test_stub_without_a_definition_is_removed(run):
    run("stubs", "my_msgs")
    own = Path("typings/my_msgs/msg/own.pyi")
    own.write_text("x: int\n", encoding="utf-8")
    Path("my_msgs/msg/Note.msg").unlink()
    assert run("stubs", "my_msgs")[0] == 0
    assert {one.name for one in own.parent.iterdir()} == {"own.pyi"}


def test_every_stub_is_valid_python_without_private_methods():
    definitions, problems = packages_with_dependencies([], Search([BUNDLED]))
    assert not problems
    for path, text in stubs(definitions).items():
        functions = [one for one in ast.walk(ast.parse(text)) if isinstance(one, ast.FunctionDef)]
        assert {one.name for one in functions} <= ({"load"} if "srvgen/" in path else set()), path


def test_stubs_contain_the_comments(run):
    run("stubs", "my_msgs")
    text = Path("typings/my_msgs/srv/_fetch.pyi").read_text(encoding="utf-8")
    assert '    """Fetches."""' in text
    assert '    ok: bool = False\n    """done"""' in text


def test_stub_of_srvgen_exports_every_public_name():
    text = stubs({})["srvgen/__init__.pyi"]
    for name in set(srvgen.__all__) - {"load"}:
        assert f"import {name} as {name}\n" in text


def test_committed_stubs_are_those_that_srvgen_writes():
    # If this fails: python -m tests.types.bundled_stubs
    wanted, found = expected(), committed()
    assert sorted(found) == sorted(wanted)
    assert [path for path, text in wanted.items() if found[path] != text] == []


@pytest.mark.types
def test_mypy_knows_imported_and_loaded_classes(run, mypy, monkeypatch):
    run("stubs", "my_msgs", "std_msgs", "example_interfaces")
    Path("user.py").write_text(USER + MISTAKES, encoding="utf-8")
    root = Path(srvgen.__file__).parents[2]
    monkeypatch.setenv("MYPYPATH", os.pathsep.join(["typings", str(root)]))
    found = mypy("--no-error-summary", "--follow-imports=silent", "user.py", "typings")
    lines = [one.partition("user.py:")[2].partition(":")[0] for one in found]
    assert list(dict.fromkeys(lines)) == WRONG_LINES, found


@pytest.mark.types
def test_pyright_knows_the_types_of_imported_and_loaded_classes(run):
    run("stubs", "my_msgs", "std_msgs", "example_interfaces")
    Path("user.py").write_text(USER + MISTAKES, encoding="utf-8")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pyright",
            "--pythonpath",
            sys.executable,
            "--level",
            "error",
            "user.py",
            "typings",
        ],
        capture_output=True,
        text=True,
    )
    errors = [one for one in done.stdout.splitlines() if " - error:" in one]
    lines = [one.partition("user.py:")[2].partition(":")[0] for one in errors]
    assert list(dict.fromkeys(lines)) == WRONG_LINES, done.stdout
