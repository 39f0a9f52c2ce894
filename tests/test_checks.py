"""`.ci/run` starts in any shell, and knows every check of the list."""

import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests import source_tree

ROOT = source_tree.ROOT
CHECKS = tomllib.loads((ROOT / ".ci" / "checks.toml").read_text(encoding="utf-8"))["check"]


@pytest.mark.skipif(sys.platform == "win32", reason="a script for sh")
@pytest.mark.parametrize("start", [[], ["sh"], ["bash"]], ids=["as a program", "sh", "bash"])
def test_it_lists_the_checks_from_any_folder(start, tmp_path):
    if start and shutil.which(start[0]) is None:
        pytest.skip(f"no {start[0]} here")
    command = [*start, str(ROOT / ".ci" / "run"), "--list"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [line.split()[0] for line in ended.stdout.splitlines()] == [
        each["name"] for each in CHECKS
    ]


def test_the_makefile_knows_every_check():
    lines = (ROOT / "Makefile").read_text(encoding="utf-8").splitlines()
    rules = [line for line in lines if line[:1].isalpha() and line.endswith(":")]
    words = {word for rule in rules for word in rule.removesuffix(":").split()}
    assert {each["name"] for each in CHECKS} - words == {"quick"}, "`make test` is the quick suite"


@pytest.mark.parametrize("name", ["interop", "labs", "notebooks", "postgres", "types"])
def test_a_check_of_some_folders_runs_all_tests_with_its_mark(name):
    # These checks name folders, because pytest needs seconds to read the others.
    (words,) = (each["run"][-1].split() for each in CHECKS if each["name"] == name)
    assert words[words.index("-m") + 1] == name
    folders = [ROOT / word for word in words if word.startswith("tests/")]
    mark = re.compile(rf"mark\.{name}\b")
    marked = [
        path for path in (ROOT / "tests").rglob("*.py") if mark.search(path.read_text("utf-8"))
    ]
    assert marked
    assert [path for path in marked if not any(map(path.is_relative_to, folders))] == []


@pytest.mark.skipif(sys.platform == "win32", reason="runs programs of POSIX")
def test_a_check_that_failed_runs_once_more(tmp_path, monkeypatch, capsys):
    found = importlib.util.spec_from_file_location("checks", ROOT / ".ci" / "checks.py")
    checks = importlib.util.module_from_spec(found)
    monkeypatch.setitem(sys.modules, "checks", checks)
    found.loader.exec_module(checks)
    once = "sh -c 'test -e tried || { touch tried; exit 1; }'"
    (tmp_path / ".ci").mkdir()
    (tmp_path / ".ci" / "checks.toml").write_text(
        f"[programs]\n{check('once', once)}{check('never', 'false')}", encoding="utf-8"
    )
    monkeypatch.setattr(checks, "ROOT", tmp_path)
    folder = Path(sys.executable).parent
    monkeypatch.setattr(checks.Environments, "folder_of", lambda self, extras: folder)
    monkeypatch.setattr(sys, "argv", [".ci/run", "once"])
    assert checks.main() == 0
    table = capsys.readouterr().out.rpartition("minutes\n")[2].split()
    assert table[::3] == ["once", "once"]
    assert table[2::3] == ["FAILED", "passed"]
    monkeypatch.setattr(sys, "argv", [".ci/run"])
    assert checks.main() == 1


def check(name, command):
    return (
        f'[[check]]\nname = "{name}"\nwhat = "a check"\nrun = ["{command}"]\nenvironment = ""\n'
        "minutes = 1\n"
    )
