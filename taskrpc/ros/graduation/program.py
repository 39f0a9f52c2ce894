"""A parsed program: its clients, its callbacks, and the calls that happen inside callbacks."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple, TypeAlias

from taskrpc.ros.colcon.programs import imports

Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda

SPINS = frozenset({"spin", "spin_once", "spin_until_future_complete"})
"""The functions of rclpy that run callbacks."""

_CALLBACK_AT = {
    "add_done_callback": 0,
    "add_on_set_parameters_callback": 0,
    "create_guard_condition": 0,
    "create_service": 2,
    "create_subscription": 2,
    "create_timer": 1,
}
"""The methods that take a callback, with its position among the arguments."""


class Finding(NamedTuple):
    """A place in a program or a package where a real ROS 2 behaves differently."""

    line: int
    column: int
    """Counted from 1, like the line."""
    what: str
    """What the program does there."""
    ros: str
    """What a real ROS 2 does."""
    fix: str
    """What to write instead."""

    def __str__(self) -> str:
        return f"{self.what}; {self.ros}; {self.fix}"


def finding_at(node: ast.AST, what: str, ros: str, fix: str) -> Finding:
    """A finding at the place where a syntax node begins."""
    line, column = getattr(node, "lineno", 1), getattr(node, "col_offset", 0)
    return Finding(line, column + 1, what, ros, fix)


class Callback(NamedTuple):
    """A function that an executor calls."""

    kind: str
    """The method that takes the callback, such as `create_service`."""
    function: Function
    name: str
    made: ast.Call
    """The call of that method."""


class Step(NamedTuple):
    """A call that happens inside a callback, directly or through other functions."""

    call: ast.Call
    callback: Callback
    through: tuple[str, ...]
    """The names of the functions from the callback to the one that contains the call."""


class Program:
    """The syntax tree of a program, and the parts of it that matter to ROS 2."""

    def __init__(self, tree: ast.Module) -> None:
        self.tree = tree
        self.calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        self._parents = {
            child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)
        }

    def made_by(self, method: str) -> list[ast.Call]:
        """The calls of a method or function of this name."""
        return [call for call in self.calls if called(call) == method]

    def above(self, node: ast.AST) -> Iterator[ast.AST]:
        """The nodes that contain a node, from the innermost outwards."""
        while (found := self._parents.get(node)) is not None:
            yield found
            node = found

    def function_of(self, node: ast.AST) -> Function | None:
        """The innermost function that contains a node."""
        kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
        return next((each for each in self.above(node) if isinstance(each, kinds)), None)

    @cached_property
    def imports_rclpy(self) -> bool:
        """Whether this is a program for ROS 2."""
        return any(name.partition(".")[0] == "rclpy" for name, _ in imports(self.tree))

    @cached_property
    def clients(self) -> dict[str, ast.Call]:
        """The variables that hold a client, such as `self.client`, each with its creation."""
        found = {}
        for call in self.made_by("create_client"):
            for target in self._targets(call):
                found[target] = call
        return found

    @cached_property
    def callbacks(self) -> list[Callback]:
        """The functions that executors call."""
        found = []
        for kind, position in _CALLBACK_AT.items():
            for call in self.made_by(kind):
                given = argument(call, position, "callback")
                for function, name in self._resolved(given):
                    found.append(Callback(kind, function, name, call))
        return found

    @cached_property
    def inside(self) -> list[Step]:
        """All calls that happen inside callbacks."""
        return [step for callback in self.callbacks for step in self._steps(callback)]

    def _steps(self, callback: Callback) -> Iterator[Step]:
        seen: set[Function] = set()
        waiting: list[tuple[Function, tuple[str, ...]]] = [(callback.function, (callback.name,))]
        while waiting:
            function, through = waiting.pop()
            if function in seen:
                continue
            seen.add(function)
            for node in own_nodes(function):
                if isinstance(node, ast.Call):
                    yield Step(node, callback, through)
                    for called_, name in self._resolved(node.func):
                        waiting.append((called_, (*through, name)))

    def _targets(self, call: ast.Call) -> Iterator[str]:
        parent = self._parents.get(call)
        targets: Sequence[ast.expr] = ()
        if isinstance(parent, ast.Assign):
            targets = parent.targets
        elif isinstance(parent, ast.AnnAssign | ast.NamedExpr):
            targets = [parent.target]
        yield from filter(None, map(dotted, targets))

    def _resolved(self, node: ast.expr | None) -> Iterator[tuple[Function, str]]:
        """The functions of this program that an expression refers to."""
        if isinstance(node, ast.Lambda):
            yield node, "lambda"
        elif isinstance(node, ast.Call) and called(node) == "partial" and node.args:
            yield from self._resolved(node.args[0])
        elif isinstance(node, ast.Attribute) and dotted(node) == f"self.{node.attr}":
            home = next((each for each in self.above(node) if isinstance(each, ast.ClassDef)), None)
            yield from _named(home.body if home else [], node.attr)
        elif isinstance(node, ast.Name):
            for function in self.above(node):
                if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                    yield from _named(own_nodes(function), node.id)
            yield from _named(self.tree.body, node.id)


def called(call: ast.Call) -> str:
    """The last part of the called function's name."""
    if isinstance(call.func, ast.Attribute):
        return call.func.attr
    return call.func.id if isinstance(call.func, ast.Name) else ""


def receiver(call: ast.Call) -> str:
    """The object whose method is called, such as `self.client`."""
    return dotted(call.func.value) if isinstance(call.func, ast.Attribute) else ""


def dotted(node: ast.AST) -> str:
    """An expression such as `self.client` as text, or "" if it is not a dotted name."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        before = dotted(node.value)
        return f"{before}.{node.attr}" if before else ""
    return ""


def argument(call: ast.Call, position: int, name: str) -> ast.expr | None:
    """An argument by its position or its name."""
    if position < len(call.args):
        return call.args[position]
    return next((each.value for each in call.keywords if each.arg == name), None)


def own_nodes(function: Function) -> Iterator[ast.AST]:
    """The nodes of a function, without those of functions and classes inside it."""
    body = [function.body] if isinstance(function, ast.Lambda) else function.body
    waiting: list[ast.AST] = list(reversed(body))
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda):
            waiting += reversed(list(ast.iter_child_nodes(node)))


def _named(body: Iterable[ast.AST], name: str) -> Iterator[tuple[Function, str]]:
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name == name:
            yield node, name
