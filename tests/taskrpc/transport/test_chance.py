"""Everything random comes from one source, and no order of a set decides what happens."""

from __future__ import annotations

import ast
import functools
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from taskrpc.testing import VirtualTimeLoop
from taskrpc.transport.chance import chance_of, present_chance

ROOT = Path(__file__).parents[3]
PACKAGES = ("taskrpc", "srvgen")
TEMPLATES = ("taskrpc/labs/files/", "taskrpc/browser_lab/async_files/")
"""Files of students, some with blanks for their names: they are not Python yet."""

GENERATORS = {"random", "secrets"}
"""Modules that draw random numbers."""
FUNCTIONS = {"urandom", "uuid1", "uuid4"}
"""Functions of other modules that do."""

MAY_DRAW = {
    "taskrpc/transport/chance.py": "the source itself",
    "taskrpc/testing/clock.py": "makes the source of a seed",
    "taskrpc/testing/call_faults.py": "each fault has a seed of its own",
    "taskrpc/testing/faulty_connections.py": "the faults of a network have a seed of their own",
    "taskrpc/fleet/postgres_store.py": "a real database, which virtual time cannot replace",
    "taskrpc/transport/tcp/tcp_network.py": "the secret of a program on a real network",
    "taskrpc/transport/ros/ros_engine.py": "a real middleware",
    "taskrpc/transport/zenoh/services.py": "a real middleware",
    "taskrpc/transport/zenoh/topics.py": "a real middleware",
    "taskrpc/web/tokens.py": "the secrets of the live page",
    "taskrpc/classroom/register.py": "the secrets of students",
    "taskrpc/labs/": "tests of students' programs must differ each time",
    "taskrpc/browser_lab/tab/trial.py": "the same, in the browser",
    "taskrpc/ros/packages/": "programs of their own, as ROS has them",
}

MAY_ITERATE = {  # tools that run once, and no part of a simulated system
    "taskrpc/cli/",
    "taskrpc/labs/",
    "taskrpc/browser_lab/",
    "taskrpc/graduation/",
    "taskrpc/ros/packages/",
}


@functools.cache
def sources() -> list[tuple[str, ast.Module]]:
    return list(_sources())


def _sources() -> Iterator[tuple[str, ast.Module]]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith(TEMPLATES):
                yield name, ast.parse(path.read_text(encoding="utf-8"))


def draws(tree: ast.Module) -> list[int]:
    """The lines of a module that use a generator other than `taskrpc.transport.chance`."""
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


# The source


def test_loop_with_a_seed_is_the_source_of_everything_that_runs_on_it():
    async def drawn():
        chance = present_chance()
        return chance.random(), chance.randbytes(4)

    expected = random.Random(7)
    loop = VirtualTimeLoop(7)
    try:
        assert loop.run_until_complete(drawn()) == (expected.random(), expected.randbytes(4))
        assert chance_of(loop).random() == expected.random()
    finally:
        loop.close()


async def test_loop_without_a_seed_has_the_operating_systems_numbers(monkeypatch):
    monkeypatch.setattr("os.urandom", lambda count: b"\xff" * count)
    assert present_chance().randbytes(3) == b"\xff\xff\xff"
    assert present_chance().random() == 1 - 2**-53, "the largest number below 1"


def test_outside_of_a_loop_the_operating_system_is_the_source():
    assert len(present_chance().randbytes(16)) == 16
    assert 0 <= present_chance().random() < 1
