"""What `taskrpc --help` and the help page of each command show."""

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import srvgen.cli.main
from taskrpc.cli import call, main
from taskrpc.cli.robot.server import command_line as server
from taskrpc.cli.shared import parsing
from tests.installed import add_package

CLI = Path(main.__file__).parent


def _with_children(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield from _with_children(child)


def _pages() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    calling = parsing.Parser(prog="taskrpc-call")
    call.configure(calling)
    for parser in (calling, server._parser(), *_with_children(srvgen.cli.main._parser())):
        yield parser.prog, parser
    for name in main.COMMANDS:
        for action in main.parser_of(name)._actions:
            if isinstance(action, argparse._SubParsersAction):
                for parser in _with_children(action.choices[name]):
                    yield parser.prog, parser


def _names_read_by(*folders: Path) -> set[str]:
    """Each attribute that the modules of a command read, and each string that they contain."""
    names = set()
    for folder in folders:
        for path in folder.rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute):
                    names.add(node.attr)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    names.add(node.value)
    return names


def test_module_or_folder_of_each_command_has_its_name():
    homes = {name: module.removesuffix(".command_line") for name, module in main._MODULES.items()}
    assert {name: home.rpartition(".")[2] for name, home in homes.items()} == {
        name: name for name in main.COMMANDS
    }


def test_no_help_page_shows_an_option_that_does_nothing():
    read = _names_read_by(CLI, Path(srvgen.cli.main.__file__).parent)
    idle = [
        f"{page} {action.option_strings[0]}"
        for page, parser in _pages()
        for action in parser._actions
        if action.option_strings
        and action.help != argparse.SUPPRESS
        and action.dest not in {"help", *read}
    ]
    assert idle == []
    for page, parser in _pages():
        said = re.search(r"chang\w+ nothing|no effect|does nothing", parser.format_help())
        assert said is None, page


def _faults_of_style(action: argparse.Action) -> Iterator[str]:
    """Yield what the help text of an argument does not keep of the style in CONTRIBUTING.md."""
    text, default = action.help, action.default
    if isinstance(action, argparse._HelpAction | argparse._SubParsersAction) or not text:
        return  # argparse's own words, as in ros2
    if text[0].islower():
        yield "starts with a small letter"
    if text.endswith("."):
        yield "ends with a full stop"
    is_shown = isinstance(default, str | int | float) and not isinstance(default, bool)
    if is_shown and default not in ("", argparse.SUPPRESS):
        said = f"{default:g}" if isinstance(default, float) else str(default)
        # Words say more than "." or a 0 that stands for "no limit" or "all".
        expected = "(default: " if default in (0, ".") else f"(default: {said})"
        if expected not in text:
            yield f"lacks (default: {said})"


def test_all_help_texts_have_one_style():
    faults = [
        f"{page} {action.dest}: {fault}: {action.help}"
        for page, parser in _pages()
        for action in parser._actions
        if action.help != argparse.SUPPRESS
        for fault in _faults_of_style(action)
    ]
    faults += [
        f"{page}: {parser.description}"
        for page, parser in _pages()
        if (text := parser.description) and (text[0].islower() or re.fullmatch(r"[^.]*\.", text))
    ]
    assert faults == []


@pytest.mark.parametrize(
    "text", ["how many (default: 3)", "How many (default: 3).", "How many (3)"]
)
def test_help_text_of_another_style_is_found(text):
    parser = argparse.ArgumentParser()
    assert list(_faults_of_style(parser.add_argument("--many", default=3, help=text)))


def test_simulated_time_is_an_option_of_the_commands_that_measure_time():
    shown = {page for page, parser in _pages() if "--use-sim-time" in parser.format_help()}
    # `hz --wall-time` names it in its own help text as well.
    assert shown == {"taskrpc topic bw", "taskrpc topic delay", "taskrpc topic hz"}


@pytest.mark.parametrize(
    "line",
    [
        "service list --no-daemon --spin-time 2 -s",
        "topic echo /chatter --qos-liveliness automatic",
        "topic echo /chatter --qos-liveliness-lease-duration-seconds 2",
        "colcon build --symlink-install --cmake-args X=1 --parallel-workers 2",
        "doctor --report --include-warnings",
    ],
)
def test_options_of_ros_that_do_nothing_here_are_accepted(line):
    words = line.split()
    main.parser_of(words[0]).parse_args(words)


def test_help_lists_the_commands_under_headings(capsys):
    assert main.main([]) == 0
    shown = capsys.readouterr().out
    headings = re.findall(r"^(.*):\n  [\w-]", shown, re.M)
    assert headings[1:] == ["Commands", "Your shell and your Python", "Classes", "ROS packages"]
    for name, purpose in main.COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(purpose)}$", shown, re.M)


def test_a_command_of_another_package_that_returns_nothing_succeeds(monkeypatch, capsys):
    module = ModuleType("greet_command", "Greet everybody.")
    module.configure = lambda parser: parser.set_defaults(run=lambda options: print("Hello!"))
    monkeypatch.setattr(main, "_added_commands", lambda command: {"greet": module})
    assert main.main(["greet"]) == 0
    assert capsys.readouterr().out == "Hello!\n"


def test_the_help_of_run_names_ros_enable():
    assert "taskrpc ros enable" in next(
        parser.format_help() for page, parser in _pages() if page == "taskrpc run"
    )


# Commands of other packages

GREET = '''"""Greet a person."""

def configure(parser):
    parser.add_argument("name")
    parser.set_defaults(run=lambda options: print(f"Hello, {options.name}!") or 3)
'''


def ran(arguments):
    """The exit code of a command, also of a page of help."""
    try:
        return main.main(arguments)
    except SystemExit as ended:
        return ended.code


@pytest.fixture
def add_commands(tmp_path, monkeypatch):
    """Install a package with these modules and commands."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def add(modules, commands):
        add_package(tmp_path, "greeting", modules, {main.ENTRY_POINTS: commands})

    return add


def test_a_command_of_another_package_runs_and_has_help(add_commands, capsys):
    add_commands({"greet_command": GREET}, {"greet": "greet_command"})
    assert ran(["greet", "Ada"]) == 3
    assert capsys.readouterr().out == "Hello, Ada!\n"
    assert ran(["greet"]) == 2
    assert "arguments are required: name" in capsys.readouterr().err
    assert ran(["--help"]) == 0
    assert "Of other packages:\n  greet      Greet a person\n" in capsys.readouterr().out


def test_no_package_replaces_a_command_of_taskrpc(add_commands, capsys):
    add_commands({"greet_command": GREET}, {"task": "greet_command", "bag": "greet_command"})
    assert ran(["task", "-h"]) == 0
    assert "Greet" not in capsys.readouterr().out
    assert ran(["--help"]) == 0
    assert "Of other packages" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("", "AttributeError: the module has no function configure(parser)"),
    ],
)
def test_a_command_that_cannot_be_used_is_named_and_left_out(add_commands, capsys, text, problem):
    name = f"broken_{len(text)}_command"
    add_commands({name: text, "greet_command": GREET}, {"broken": name, "greet": "greet_command"})
    assert ran(["--help"]) == 0
    out, err = capsys.readouterr()
    assert err == (
        "taskrpc: the package greeting adds the command 'broken' with the module"
        f" {name}, which cannot be used: {problem}\n"
    )
    assert "greet      Greet a person" in out
    assert "broken" not in out
    assert ran(["greet", "Ada"]) == 3
    assert capsys.readouterr().err == ""


def test_an_entry_point_of_a_command_names_no_function(add_commands, capsys):
    add_commands({"greet_command": GREET}, {"greet": "greet_command:configure"})
    assert ran(["greet", "Ada"]) == 2
    problem = "cannot be used: TypeError: expected the name of a module only, without a colon\n"
    assert problem in capsys.readouterr().err


def test_a_command_that_sets_no_function_is_a_mistake_of_its_package(add_commands, capsys):
    text = "def configure(parser):\n    parser.add_argument('name')"
    add_commands({"idle_command": text}, {"idle": "idle_command"})
    assert ran(["idle", "Ada"]) == 1
    out, err = capsys.readouterr()
    assert not out
    assert "the command 'idle' sets no function that runs it" in err


def test_our_own_commands_search_no_installed_packages(monkeypatch):
    monkeypatch.setattr("importlib.metadata.entry_points", None)
    assert ran(["task", "-h"]) == 0
