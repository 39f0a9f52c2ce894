"""A request arrives unchanged from every shell, or the error says how to type it in that shell.

Each shell is modelled as far as it changes arguments: what it takes away itself, and how Windows
programs split the one command line that they are given.
"""

from __future__ import annotations

import shlex

import pytest

import srvgen
from taskrpc.cli.shared import quoting, values
from taskrpc.errors import InvalidRequest

ADD = srvgen.load("example_interfaces/srv/AddTwoInts").Request
TASK = srvgen.load("my_robot_interfaces/srv/RobotTask").Request
GIT = "C:/Program Files/Git"


def split_windows(line: str) -> list[str]:
    """A command line as Microsoft's C runtime splits it (no backslashes before quotes here)."""
    words, word, quoted = [], None, False
    for char in line:
        if char == '"':
            quoted = not quoted
            word = word or ""
        elif char in " \t" and not quoted:
            if word is not None:
                words.append(word)
            word = None
        else:
            word = (word or "") + char
    return words if word is None else [*words, word]


def cmd(typed: str) -> list[str]:
    """cmd hands the line over as it is."""
    return split_windows(typed)


def bash(typed: str) -> list[str]:
    """bash takes both kinds of quotes away."""
    return shlex.split(typed)


def powershell51(typed: str) -> list[str]:
    """PowerShell 5.1 takes quotes away and puts new ones only around what has spaces."""
    given = shlex.split(typed)
    line = " ".join(f'"{one}"' if " " in one and one[0] != '"' else one for one in given)
    return split_windows(line)


def git_bash(typed: str) -> list[str]:
    """Git Bash gives Windows programs Windows paths."""
    return [GIT + word if word.startswith("/") else word for word in shlex.split(typed)]


EVERY_SHELL = pytest.mark.parametrize("shell", [bash, powershell51, cmd, git_bash])


def test_the_model_of_windows_splits_as_windows_does():
    assert split_windows('a "b c" "" d"e f"g') == ["a", "b c", "", "de fg"]


@EVERY_SHELL
def test_field_value_needs_no_quotes_in_any_shell(shell):
    argv = shell("task_type=move target=3,4 priority=8")
    request = values.build_request(TASK, argv)
    assert request == TASK(task_type="move", target="3,4", priority=8)


@EVERY_SHELL
def test_yaml_in_double_quotes_works_in_every_shell(shell):
    assert values.build_request(ADD, shell('"{a: 2, b: -3}"')) == ADD(a=2, b=-3)


@EVERY_SHELL
def test_double_quotes_around_field_value_carry_spaces_in_every_shell(shell):
    request = values.build_request(TASK, shell('"target=the red dock" task_type=scan'))
    assert (request.target, request.task_type) == ("the red dock", "scan")


@EVERY_SHELL
def test_type_and_request_are_distinguished_in_every_shell(shell):
    argv = shell('example_interfaces/srv/AddTwoInts "{a: 1}"')
    assert values.split_type(argv) == ("example_interfaces/srv/AddTwoInts", ["{a: 1}"])


@pytest.mark.parametrize("shell", [bash, powershell51, git_bash])
def test_single_quotes_work_in_shells_that_support_them(shell):
    assert values.build_request(ADD, shell("'{a: 2, b: 3}'")) == ADD(a=2, b=3)


def hint_for(cls, argv: list[str]) -> str:
    with pytest.raises(InvalidRequest) as caught:
        values.build_request(cls, argv)
    return " ".join([str(caught.value), *getattr(caught.value, "__notes__", ())])


@pytest.mark.parametrize("typed", ["'{a: 2, b: 3}'", "'{a:2}'", "'{}'", "'a: 1'"])
def test_single_quotes_in_cmd_are_named_as_the_cause(typed):
    assert "cmd does not support single quotes" in hint_for(ADD, cmd(typed))


def test_powershell_51_keeps_json_keys_usable_but_not_values_with_spaces_or_commas():
    assert values.build_request(ADD, powershell51("""'{"a": 2, "b": 3}'""")) == ADD(a=2, b=3)
    spaces = powershell51("""'{"target": "the dock"}'""")
    assert spaces == ["{target: the", "dock}"]
    assert "double quotes" in hint_for(TASK, spaces)
    comma = powershell51("""'{"target": "3,4"}'""")
    assert comma == ["{target: 3,4}"]
    assert "PowerShell 5.1" in hint_for(TASK, comma)


@pytest.mark.parametrize("shell", [bash, powershell51, cmd])
@pytest.mark.parametrize("typed", ["{a:2}", "{a:2,b:3}", "a:2", '"{a:2}"'])
def test_a_missing_space_after_the_colon_is_shown(shell, typed):
    assert "write a space after the colon, {a: 2}" in hint_for(ADD, shell(typed))


def test_braces_that_bash_has_expanded_get_the_same_hint():
    assert "write a space after the colon, {a: 2}" in hint_for(ADD, ["a:2", "b:3"])


@EVERY_SHELL
def test_unquoted_request_with_spaces_gets_a_hint_to_quote_it(shell):
    assert quoting.ONE_ARGUMENT in hint_for(ADD, shell("{a: 2, b: 3}"))


@pytest.mark.parametrize(
    "argv",
    [
        ["\u201c{a: 2}\u201d"],
        ["\u201c{a:", "2}\u201d"],
        ["\u2018{a: 2}\u2019"],
        ["{a: \u201c2\u201d}"],
        ["a=\u201c2\u201d"],
    ],
)
def test_curly_quotation_marks_are_reported(argv):
    assert "curly quotation marks" in hint_for(ADD, argv)


def test_curly_quotation_marks_inside_a_text_are_sent():
    request = values.build_request(TASK, ["{target: '\u201cx\u201d'}"])
    assert request.target == "\u201cx\u201d"


def test_a_value_split_at_its_space_is_shown_in_double_quotes():
    assert '"target=the dock"' in hint_for(TASK, bash("target=the dock"))


@pytest.mark.parametrize("typed", ["/robot_task", "/robot_1/robot_task"])
def test_git_bash_paths_are_recognised(typed):
    hint = quoting.name_hint(git_bash(typed)[0])
    assert "Git Bash" in hint
    assert "write robot_task without it" in hint


@pytest.mark.parametrize("name", ["/robot_task", "robot_task", "~/x", "a:b", "1/2"])
def test_other_names_are_not_blamed_on_git_bash(name):
    assert quoting.name_hint(name) == ""
