"""The programs of a folder become modules of a package and can still be started."""

import ast

import pytest

from taskrpc.ros.colcon import programs


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("import common\n", "from lesson import common\n"),
        ("import common as c, os\n", "from lesson import common as c; import os\n"),
        ("from common import (\n    A,\n    B as C,\n)\nx = 1\n", None),
        ("def f():\n    from common import *  # all\n", None),
        ("from os import path\nimport commonly\n", "from os import path\nimport commonly\n"),
        ("from .common import A\n", "from .common import A\n"),
        ("ü = 'ä'; import common; print(ü)\n", "ü = 'ä'; from lesson import common; print(ü)\n"),
    ],
)
def test_imports_of_neighbours_name_the_package(before, after):
    changed = programs.as_module(before, "lesson", {"common"})
    if after is None:
        ast.parse(changed)
        assert "from lesson.common import" in changed
    else:
        assert changed == after


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("def main(): pass\n", "p.n:main"),
        ("def main(args=None): pass\n", "p.n:main"),
        ("def main(args): pass\n", "p._scripts:n"),
        ("async def main(): pass\n", "p._scripts:n"),
        ("print(1)\n", "p._scripts:n"),
    ],
)
def test_main_without_arguments_is_called_and_other_programs_run_as_modules(text, target):
    assert programs.target(ast.parse(text), "p", "n") == target


def test_file_that_only_defines_names_is_no_program():
    assert not programs.is_program(ast.parse('"""Doc."""\nimport os\nA = 1\nclass B: pass\n'))
    assert programs.is_program(ast.parse("class B: pass\nif __name__ == '__main__':\n    B()\n"))
