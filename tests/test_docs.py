"""What README and docs show is true: every block runs, every link leads somewhere, every option is
there, and the reference tables say what the code says."""

from __future__ import annotations

import argparse
import functools
import importlib
import inspect
import itertools
import re
import shlex
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import srvgen.cli.main
import taskrpc
from taskrpc import errors
from taskrpc.cli import call, main
from taskrpc.cli.robot.server import command_line as server
from taskrpc.cli.shared import parsing
from taskrpc.core.wire import status
from taskrpc.robot.tasks.managed_robot import ManagedRobot
from taskrpc.robot.tasks.services.offered_tasks import OfferedTasks
from tests.docs.markdown import Page, read_page
from tests.docs.stage import Stage

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
REFERENCE = ROOT / "docs" / "reference"
KINDS = {
    *("python", "pycon", "console", "srv", "msg", "action"),
    *("toml", "yaml", "xml", "text", "html", "javascript"),
}
"""`tests/browser` runs `html`, `tests/interop` runs `javascript`."""

LAB_SHEETS = [page for page in PAGES if re.fullmatch(r"lab-\d\.md", page.name)]
"""`tests/labs/test_sheets.py` runs their blocks: they need the solution, and take longer."""

NOT_RUN = {
    "README.md": 2,
    "CONTRIBUTING.md": 1,
    "docs/tutorial/1-first-service.md": 2,
    "docs/how-to/check-types.md": 1,
    "docs/how-to/reach-another-machine.md": 8,
    "docs/teach/README.md": 2,
    "docs/how-to/teach-a-class.md": 13,
    "docs/explanation/from-one-laptop-to-a-fleet.md": 1,
    "docs/how-to/run-a-fleet.md": 7,
    "docs/how-to/run-ros-programs.md": 1,
    "docs/how-to/grade-labs.md": 3,
    "docs/how-to/run-the-labs-in-a-browser.md": 3,
    "docs/how-to/paste-ros2-lines.md": 2,
    "docs/how-to/work-in-a-notebook.md": 8,  # tests/notebooks runs them in a kernel
    "docs/how-to/show-a-scene.md": 3,  # seconds of waiting
    "docs/how-to/take-a-program-to-a-robot.md": 1,
    "docs/how-to/use-rosbridge.md": 3,
    "docs/how-to/run-on-a-ros-2-robot.md": 6,
    "docs/how-to/reach-a-robot-from-laptops.md": 3,
    "docs/how-to/use-zenoh.md": 7,  # a router, and a machine with ROS 2
}
"""Blocks that a test cannot run (virtual environments, other machines), counted for each page."""


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


every_page = pytest.mark.parametrize("page", PAGES, ids=_name)
page_at = functools.cache(read_page)


@pytest.fixture(scope="module")
def played(request, tmp_path_factory) -> Iterator[dict[Path, Future[None]]]:
    """The pages that this run asks for, played side by side: most of their time is waiting."""
    items = [item for item in request.session.items if item.path == request.path]
    wanted = {item.callspec.params["page"] for item in items if "played" in item.fixturenames}
    with ThreadPoolExecutor(3) as pool:
        yield {
            path: pool.submit(Stage(tmp_path_factory.mktemp("docs")).play, page_at(path))
            for path in sorted(wanted)
        }


@pytest.mark.end_to_end
@pytest.mark.real_time
@pytest.mark.parametrize("page", [page for page in PAGES if page not in LAB_SHEETS], ids=_name)
def test_code_blocks_of_a_page_give_the_output_that_it_shows(page, played):
    if problem := played[page].exception():
        pytest.fail(str(problem), pytrace=False)


@every_page
def test_a_block_is_of_a_kind_that_is_checked_and_says_so_when_it_is_not_run(page):
    blocks = page_at(page).blocks
    assert {block.kind for block in blocks} <= KINDS
    assert all(block.notes.get("not run", "a reason") for block in blocks)
    assert sum("not run" in block.notes for block in blocks) == NOT_RUN.get(_name(page), 0)


@pytest.mark.parametrize("page", [*PAGES, *sorted((ROOT / "examples").rglob("*.md"))], ids=_name)
def test_every_link_leads_to_a_page_and_a_heading(page):
    for link in page_at(page).links():
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        target, _, anchor = link.partition("#")
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), f"{link}: there is no {target}"
        assert not anchor or anchor in page_at(path).anchors(), f"{link}: no such heading"


def test_the_index_names_every_page():
    index = ROOT / "docs" / "README.md"
    linked = {(index.parent / link).resolve() for link in page_at(index).links()}
    assert linked >= {path for path in PAGES if path.name != "README.md"}


# Commands and their options


@functools.cache
def commands() -> dict[str, dict[str, bool]]:
    """Every command, by what is typed, with its options and whether they are documented there."""
    found = {
        "taskrpc-server": server._parser(),
        "taskrpc-call": _configured(call.configure, "taskrpc-call"),
        **_with_children(srvgen.cli.main._parser(), "srvgen"),
    }
    for name in main.COMMANDS:
        found |= _with_children(main.parser_of(name), "taskrpc", only=name)
    return {typed: _options(parser) for typed, parser in found.items()}


def _configured(configure: Any, prog: str) -> argparse.ArgumentParser:
    parser = parsing.Parser(prog=prog)
    configure(parser)
    return parser


def _with_children(
    parser: argparse.ArgumentParser, typed: str, only: str = ""
) -> dict[str, argparse.ArgumentParser]:
    found = {typed: parser}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, child in action.choices.items():
                if not only or name == only:
                    found |= _with_children(child, f"{typed} {name}")
    return found


def _options(parser: argparse.ArgumentParser) -> dict[str, bool]:
    return {
        option: action.help != argparse.SUPPRESS
        for action in parser._actions
        for option in action.option_strings
    }


def _command_of(words: list[str]) -> str:
    """The longest beginning of a command line that is a command, or ""."""
    typed = [" ".join(words[:count]) for count in (3, 2, 1)]
    return next((each for each in typed if each in commands()), "")


def _command_lines(page: Page) -> Iterator[str]:
    for block in page.blocks:
        if block.kind == "console":
            yield from re.findall(r"^\$ (.*)$", block.text, flags=re.M)
    yield from page.inline_code()


@every_page
def test_every_command_and_option_that_a_page_names_exists(page):
    for line in _command_lines(page_at(page)):
        for part in re.split(r"\s(?:&&|\|)\s", line):
            words = [word for word in _words(part) if "=" not in word.split("-")[0]]
            if command := _command_of([word.rpartition("/")[2] for word in words]):
                following = " ".join(words[len(command.split()) :][:1])
                is_group = any(each.startswith(f"{command} ") for each in commands())
                is_added = command == "taskrpc" and following == "boxes"  # by extend-taskrpc.md
                assert not (is_group and following.isidentifier()) or is_added, f"`{part}`"
                ours = itertools.takewhile(lambda word: word != "--ros-args", words)
                if command == "taskrpc run":  # the program has the options after its name
                    ours = itertools.takewhile(
                        lambda word: word.startswith("-") or word in ("taskrpc", "run"), ours
                    )
                given = [word for word in ours if re.match(r"--?[a-zA-Z]", word)]
                options = {word.partition("=")[0] for word in given}
                assert options <= set(commands()[command]), f"`{part}`"


def _words(line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError:
        return line.split()


def test_the_reference_has_every_command_with_every_option():
    page = page_at(REFERENCE / "commands.md")
    missing = {}
    for command, options in commands().items():
        own = page.section(f"`{command}`").partition("\n#")[0]
        told = {"-h", "--help", *re.findall(r"(?<![\w-])--?\w[\w-]*", own)}
        missing[command] = {option for option, shown in options.items() if shown} - told
    assert not any(missing.values()), {name: some for name, some in missing.items() if some}


# The Python interface

MODULES = {
    "taskrpc": taskrpc.__all__,
    "taskrpc.sync": importlib.import_module("taskrpc.sync").__all__,
    "taskrpc.robot.fleet": importlib.import_module("taskrpc.robot.fleet").__all__,
    "taskrpc.course.notebook": importlib.import_module("taskrpc.course.notebook").__all__,
    "taskrpc.logs": ["CallFilter", "JsonFormatter", "TextFormatter", "handler"],
    "taskrpc.observe.metrics": "Family Histogram Kind Sample render store_families".split(),
    "taskrpc.observe.metrics.tasks": ["MeasuredStore", "task_families"],
    "taskrpc.observe.web": importlib.import_module("taskrpc.observe.web").__all__,
    "taskrpc.observe.otel": ["Tracing"],
    "taskrpc.testing": importlib.import_module("taskrpc.testing").__all__,
    "taskrpc.simulation": importlib.import_module("taskrpc.simulation").__all__,
    "taskrpc.robot": importlib.import_module("taskrpc.robot").__all__,
    "srvgen": srvgen.__all__,
}
NOT_CONSTRUCTED = {
    "Action",
    "ActionClient",
    "ActionServer",
    "CallInfo",
    "Client",
    "DeferredCall",
    "GoalHandle",
    "GoalState",
    "Kind",
    "Msg",
    "NodeStatus",
    "Publisher",
    "Robot",
    "RobotTelemetry",
    "Role",
    "ServerGoal",
    "Service",
    "SimulatedWorld",
    "Srv",
    "Subscription",
    "Timer",
}
"""Protocols, and classes whose objects only taskrpc creates: their constructors are not public."""

OWN_BASES = OfferedTasks, ManagedRobot
"""Bases whose members the reference lists with their subclasses."""
ERRORS = {name for name, value in vars(errors).items() if inspect.isclass(value) and name[0] != "_"}


def _signature(function: Any, name: str) -> str:
    """`name(a, b=1)`: names and defaults, without types; `await` where it must be awaited."""
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except ValueError:
        parameters = []
    if parameters and parameters[0].name == "self":
        parameters = parameters[1:]
    plain = [each.replace(annotation=inspect.Parameter.empty) for each in parameters]
    text = f"{name}{inspect.Signature(plain)}"
    text = text.replace("'", '"')
    text = re.sub(r"<(\w+\.\w+): [^>]*>", r"\1", text)  # members of an Enum
    text = re.sub(r"<(?:built-in )?function (\w+)(?: at \w+)?>", r"\1", text)
    return f"await {text}" if inspect.iscoroutinefunction(function) else text


def _interface_of(value: Any, name: str) -> Iterator[str]:
    """A public name, and below a class its public methods and properties.

    Those of a private base class belong to the class that users see; so do those of OfferedTasks,
    which task servers of all kinds have.
    """
    if not inspect.isclass(value):
        yield _signature(value, name)
        return
    yield name if name in NOT_CONSTRUCTED else _signature(value, name)
    ours = [each for each in value.__mro__[1:] if each.__module__.startswith("taskrpc.")]
    bases = [each for each in ours if each.__name__.startswith("_") or each in OWN_BASES]
    members = itertools.chain.from_iterable(vars(each).items() for each in (value, *bases))
    for member, found in members:
        if member.startswith("_"):
            continue
        if isinstance(found, property):
            yield member
        elif inspect.isfunction(found):
            yield _signature(found, member)


@pytest.mark.parametrize("module", MODULES)
def test_the_reference_has_every_public_name_with_its_signature(module):
    home = importlib.import_module(module)
    section = page_at(REFERENCE / "python-api.md").section(f"`{module}`")
    told = set(re.findall(r"^(?:#+|-) `(.+?)`", section, flags=re.M))
    elsewhere = ERRORS | set(MODULES["taskrpc.robot"] if module == "taskrpc" else ())
    wanted = {
        signature
        for name in MODULES[module]
        if name not in elsewhere
        for signature in _interface_of(getattr(home, name), name)
    }
    assert told == wanted


# Tables


def test_the_table_of_errors_is_the_tree_of_errors():
    codes = {cls.__name__: code.name for cls, code in status._CODES}
    told = {
        (name, code, fate)
        for name, code, fate, *_ in page_at(REFERENCE / "errors.md").rows("All errors")
    }
    wanted = {
        (name, codes.get(name, "—"), str(getattr(errors, name).not_executed))
        for name in ERRORS - {"Code", "IntEnum"}
    }
    assert told == wanted


def test_the_table_of_status_codes_has_all_of_them():
    rows = page_at(REFERENCE / "errors.md").rows("Status codes")
    assert [(int(number), name) for number, name, *_ in rows] == [
        (code.value, code.name) for code in errors.Code
    ]


def test_the_table_of_variables_has_every_one_that_the_code_reads():
    sources = [*(ROOT / "taskrpc").rglob("*.py"), *(ROOT / "srvgen").rglob("*.py")]
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    read = set(re.findall(r"(?:environ(?:\.get\(|\[)|_environment\()\"([A-Z_]+)\"", text))
    assert read >= {"ROS_DOMAIN_ID", "TASKRPC_PEERS"}
    told = {name for name, *_ in page_at(REFERENCE / "environment.md").rows("Variables")}
    assert told == read


async def test_the_table_of_metrics_has_every_one(tmp_path):
    from taskrpc.observe.metrics.tasks import MeasuredStore, task_families

    store = MeasuredStore(taskrpc.SqliteStore(tmp_path / "tasks.db"))
    robot = taskrpc.KinematicRobot(taskrpc.default_world())
    async with taskrpc.Node("node", transport="memory") as node:
        metrics = taskrpc.Metrics()
        metrics.add(store.families)
        metrics.add(lambda: task_families(taskrpc.TaskServer(node, robot, store).manager))
        found = metrics.families()
    rows = page_at(REFERENCE / "metrics.md").rows("All metrics")
    told = re.findall(r"taskrpc_\w+", " ".join(names for names, *_ in rows))
    assert sorted(told) == sorted(family.name for family in found)


# The checks themselves

LIES = {
    "another output": "```console\n$ srvgen hash std_msgs/msg/Empty\nRIHS01_0\n```",
    "an exit code": "```console\n$ taskrpc --version\n…\n$ echo $?\n1\n```",
    "a failure unsaid": "```console\n$ srvgen hash no_such/msg/Type\n…\n```",
    "a program that raises": "```python\nraise SystemExit(3)\n```",
    "a session": "```pycon\n>>> 1 + 1\n3\n```",
    "a definition": "```srv\nint counter\n---\n```",
    "a mistake that is none": "<!-- wrong -->\n```srv\nint32 counter\n---\n```",
    "a map": "```yaml\nsize: [1]\n```",
    "what a running program says": (
        "`run.py`\n```python\nprint('a')\n```\n"
        "<!-- terminal: one -->\n```console\n$ python run.py\nb\n```"
    ),
}


@pytest.mark.end_to_end
@pytest.mark.real_time
@pytest.mark.parametrize("lie", LIES)
def test_a_page_that_is_not_true_is_caught(lie, tmp_path):
    path = tmp_path / "page.md"
    path.write_text(f"# A page\n\n{LIES[lie]}\n", encoding="utf-8")
    with pytest.raises(AssertionError, match=r"page\.md"):
        Stage(tmp_path / "stage").play(read_page(path))
