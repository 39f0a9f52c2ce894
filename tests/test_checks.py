"""`.ci/run` starts in any shell, and knows every check of the list."""

import shutil
import subprocess
import sys
import tomllib

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
    words = (ROOT / "Makefile").read_text(encoding="utf-8")
    for each in CHECKS:
        name = "test" if each["name"] == "quick" else each["name"]
        assert f" {name}" in words
