"""The text of errors: what was expected, where, and a hint."""

from pathlib import Path

import pytest

from srvgen.errors import DefinitionError, DefinitionErrors
from srvgen.files.search import Search
from srvgen.parser import parse_msg
from tests.srvgen.sample_definitions import put

pytestmark = pytest.mark.usefixtures("workspace")


def test_only_the_first_problems_are_shown(run):
    path = put("my_msgs/msg/Bad", "int a\n" * 150)
    _, _, err = run("check", path)
    assert err.count("did you mean int32?") == 100
    assert err.endswith(f"{path}: error: and 50 more problems\n")
    put("my_msgs/msg/Bad", "int a\n" * 5000)
    assert run("check", path)[2].endswith("and at least 900 more problems\n")


def test_a_line_without_end_is_cut_around_its_caret(run):
    path = put("my_msgs/msg/Bad", "int32 " + "a" * 5000 + "B" + "c" * 5000)
    _, _, err = run("check", path)
    _, line, caret, hint = err.splitlines()
    assert len(line) < 500 > len(hint)
    assert line[caret.index("^")] == "B"


def test_control_characters_of_a_file_do_not_reach_the_terminal(run):
    path = put("my_msgs/msg/Bad", "int a\x1b[2J\n")
    assert "\x1b" not in run("check", path)[2]


def test_error_lists_the_searched_folders(workspace):
    put("my_msgs/srv/Fetch", "---", workspace)
    with pytest.raises(DefinitionError) as caught:
        Search().load("nowhere_msgs/msg/Thing")
    assert caught.value.looked_in == (str(Path.cwd()), "the packages of srvgen")
    assert str(caught.value).splitlines() == [
        "package 'nowhere_msgs' not found",
        f"  looked in: {Path.cwd()}, the packages of srvgen",
    ]
    with pytest.raises(DefinitionError) as caught:
        Search().load("my_msgs/srv/Bring")
    assert str(caught.value).endswith(f"\n  looked in: {Path.cwd() / 'my_msgs'}")


def test_a_single_problem_is_a_plain_error_with_a_caret_under_it():
    with pytest.raises(DefinitionError) as caught:
        parse_msg("int32 ok\nint8\tx  300", "my_msgs", "Wrong", path="Wrong.msg")
    assert not isinstance(caught.value, DefinitionErrors)
    assert str(caught.value) == (
        "Wrong.msg:2:9: error: expected a whole number from -128 to 127 for int8, got '300'\n"
        "    int8\tx  300\n"
        "        \t   ^"
    )
