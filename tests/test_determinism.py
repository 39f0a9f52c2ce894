"""The sources of all packages: where they draw random numbers, read the time, iterate over sets."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("taskrpc", "srvgen")
TEMPLATES = ("taskrpc/course/labs/files/", "taskrpc/course/browser_lab/async_files/")
"""Files of students, some with blanks for their names: they are not Python yet."""

GENERATORS = {"random", "secrets"}
"""Modules that draw random numbers."""
FUNCTIONS = {"urandom", "uuid1", "uuid4"}
"""Functions of other modules that do."""

MAY_DRAW = {
    "taskrpc/core/transport/chance.py": "the source itself",
    "taskrpc/testing/clock.py": "makes the source of a seed",
    "taskrpc/testing/call_faults.py": "each fault has a seed of its own",
    "taskrpc/testing/faulty_connections.py": "the faults of a network have a seed of their own",
    "taskrpc/robot/fleet/postgres/store.py": "a real database, which virtual time cannot replace",
    "taskrpc/core/transport/tcp/tcp_network.py": "the secret of a program on a real network",
    "taskrpc/course/scenes/programs/": "programs as students write them",
    "taskrpc/simulation/": "all chance of a simulation follows from its seed",
    "taskrpc/middleware/ros/ros_engine.py": "a real middleware",
    "taskrpc/middleware/zenoh/services.py": "a real middleware",
    "taskrpc/middleware/zenoh/topics.py": "a real middleware",
    "taskrpc/observe/web/tokens.py": "the secrets of the live page",
    "taskrpc/bridges/mcp/server.py": "agents on a real network, whose request ids must not meet",
    "taskrpc/course/classroom/register.py": "the secrets of students",
    "taskrpc/course/labs/": "tests of students' programs must differ each time",
    "taskrpc/course/browser_lab/tab/trial.py": "the same, in the browser",
    "taskrpc/ros/packages/": "programs of their own, as ROS has them",
}

CLOCKS = {"time.time", "time.time_ns", "datetime.now", "datetime.utcnow", "datetime.today"}
"""What reads the time of day."""

MAY_READ_THE_TIME = {
    "taskrpc/core/transport/time_of_day.py": "the source itself",
    "taskrpc/core/transport/discovery/registry.py": "the times and names of real files",
    "taskrpc/core/transport/discovery/journal.py": "the times of real files",
    "taskrpc/simulation/interpreter/clocks.py": "replaces the clocks of simulated programs",
    "taskrpc/middleware/zenoh/": "a real middleware",
    "taskrpc/core/storage/lock.py": "a line for the operator in a real file",
    "taskrpc/robot/fleet/postgres/store.py": "a real database, which virtual time cannot replace",
    "taskrpc/ros/packages/rclpy/": "works in threads, as ROS does",
    "taskrpc/observe/otel.py": "spans have the times of the program's other spans",
    "taskrpc/observe/web/": "pages show the times of this machine",
    "taskrpc/observe/top/": "the same",
    "taskrpc/course/notebook/": "the same",
    "taskrpc/course/scenes/": "the same",
    "taskrpc/course/browser_lab/": "the same",
    "taskrpc/course/classroom/": "accounts and files of a class, which outlast a program",
    "taskrpc/cli/": "commands run in real time",
    "taskrpc/ros/colcon/": "the year of a copyright",
    "taskrpc/ros/packages/": "programs of their own, as ROS has them",
}

MAY_ITERATE = {  # tools that run once, and no part of a simulated system
    "taskrpc/cli/",
    "taskrpc/course/labs/",
    "taskrpc/course/browser_lab/",
    "taskrpc/ros/graduation/",
    "taskrpc/ros/packages/",
}


@functools.cache
def sources() -> list[tuple[str, ast.Module]]:
    return list(_sources())


@pytest.fixture(scope="module", autouse=True)
def _no_sources_afterwards():
    """Forget the parsed sources: each collection of garbage in later tests would walk them."""
    yield
    sources.cache_clear()


def _sources() -> Iterator[tuple[str, ast.Module]]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith(TEMPLATES):
                yield name, ast.parse(path.read_text(encoding="utf-8"))


def draws(tree: ast.Module) -> list[int]:
    """The lines of a module that use a generator other than `taskrpc.core.transport.chance`."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            used = {each.name for each in node.names} & GENERATORS
        elif isinstance(node, ast.ImportFrom):
            used = ({node.module} & GENERATORS) | ({each.name for each in node.names} & FUNCTIONS)
        else:
            used = isinstance(node, ast.Attribute) and node.attr in FUNCTIONS
        if used:
            found.append(node.lineno)
    return found


def times(tree: ast.Module) -> list[int]:
    """The lines of a module that read the time of day elsewhere than in `time_of_day`."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "time":
            used = {f"time.{each.name}" for each in node.names} & CLOCKS
        else:
            used = isinstance(node, ast.Attribute) and is_clock(ast.unparse(node))
        if used:
            found.append(node.lineno)
    return found


def is_clock(text: str) -> bool:
    return ".".join(text.removeprefix("_").split(".")[-2:]) in CLOCKS


def name_of(node: ast.AST) -> str:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1:
        if node.func.id in ("list", "tuple", "iter"):
            return name_of(node.args[0])
        return ""
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def is_set(annotation: ast.AST) -> bool:
    text = ast.unparse(annotation)
    return text.startswith(("set[", "frozenset[", "weakref.WeakSet[", "WeakSet["))


def set_iterations(tree: ast.Module) -> list[int]:
    """The lines of a module that iterate over a set, in the order of its hashes."""
    nodes = list(ast.walk(tree))
    sets, unordered = set(), set()
    for node in nodes:
        if isinstance(node, ast.AnnAssign) and is_set(node.annotation):
            sets.add(name_of(node.target))
        elif isinstance(node, ast.Assign) and is_made_set(node.value):
            sets.update(name_of(target) for target in node.targets)
        elif isinstance(node, ast.SetComp):
            unordered.update(node.generators)
        elif is_order_free(node) and isinstance(node.args[0], ast.GeneratorExp | ast.ListComp):
            unordered.update(node.args[0].generators)
    return [
        node.iter.lineno
        for node in nodes
        if isinstance(node, ast.For | ast.comprehension)
        and node not in unordered
        and (is_made_set(node.iter) or name_of(node.iter) in sets - {""})
    ]


def is_made_set(node: ast.AST) -> bool:
    called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    return isinstance(node, ast.Set | ast.SetComp) or (
        called and node.func.id in ("set", "frozenset")
    )


def is_order_free(node: ast.AST) -> bool:
    """Whether a call gives the same result for any order of its argument."""
    free = {"any", "all", "sorted", "set", "frozenset", "sum", "len", "min", "max"}
    return isinstance(node, ast.Call) and node.args and getattr(node.func, "id", "") in free


def offences(find, allowed):
    return [
        f"{path}:{line}"
        for path, tree in sources()
        if not path.startswith(tuple(allowed))
        for line in find(tree)
    ]


def test_library_draws_random_numbers_only_from_chance():
    assert offences(draws, MAY_DRAW) == [], "use `chance_of`, or say in MAY_DRAW why not"


def test_each_exception_still_draws():
    for path in MAY_DRAW:
        assert any(draws(tree) for each, tree in sources() if each.startswith(path)), path


def test_library_reads_the_time_of_day_only_from_time_of_day():
    found = offences(times, MAY_READ_THE_TIME)
    assert found == [], "use `time_of_day`, or say in MAY_READ_THE_TIME why not"


def test_each_exception_still_reads_the_time():
    for path in MAY_READ_THE_TIME:
        assert any(times(tree) for each, tree in sources() if each.startswith(path)), path


def test_order_of_a_set_decides_nothing():
    assert offences(set_iterations, MAY_ITERATE) == [], "use a dict with None as values, or sorted"


@pytest.mark.parametrize(
    "line",
    [
        "import random",
        "from random import random",
        "import uuid; uuid.uuid4()",
        "import secrets as s",
        "import os; os.urandom(4)",
        "from os import urandom",
        "def f():\n    import random",
    ],
)
def test_another_generator_is_found(line):
    assert draws(ast.parse(line))


@pytest.mark.parametrize(
    "line",
    [
        "import time; time.time()",
        "import time as _time; _time.time_ns()",
        "from time import time",
        "def f(clock=time.time): pass",
        "import datetime; datetime.datetime.now()",
        "from datetime import datetime; datetime.now()",
    ],
)
def test_another_clock_is_found(line):
    assert times(ast.parse(line))


def test_other_functions_of_time_are_no_clocks():
    assert not times(ast.parse("import time; time.perf_counter(); from time import monotonic"))


@pytest.mark.parametrize(
    "text",
    [
        "a: set[int] = set()\nfor x in a: pass",
        "class A:\n def f(self):\n  self.a: set[int] = set()\n  for x in list(self.a): pass",
        "a = set(b)\n[x for x in a]",
        "for x in {1, 2}: pass",
        "import weakref\na: weakref.WeakSet[int] = weakref.WeakSet()\nfor x in a: pass",
    ],
)
def test_iteration_over_a_set_is_found(text):
    assert set_iterations(ast.parse(text))


@pytest.mark.parametrize(
    "text", ["a = set(b)\nsorted(x for x in a)", "a = {1: 2}\nfor x in a: pass", "1 in {1, 2}"]
)
def test_other_uses_of_sets_are_allowed(text):
    assert not set_iterations(ast.parse(text))
