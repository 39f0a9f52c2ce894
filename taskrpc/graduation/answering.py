"""Service callbacks that do not answer: no `return response` on some path, a raise."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence

from taskrpc.graduation.program import Finding, Function, Program, at, own_nodes

_UNANSWERED = "the server ends with an error in ROS 2, and the caller waits for ever"


def answering(program: Program) -> Iterator[Finding]:
    """All of these in a program."""
    told: set[Function] = set()
    for callback in program.callbacks:
        function = callback.function
        if callback.kind != "create_service" or function in told:
            continue
        told.add(function)
        if not isinstance(function, ast.Lambda):
            yield from _returns(function)
            yield from _raises(program, function)
    yield from _two_servers(program)


def _returns(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[Finding]:
    if not _ends(function.body):
        yield at(
            function,
            f"{function.name} can end without return response",
            _UNANSWERED,
            "return the response on every path",
        )
    for node in own_nodes(function):
        if isinstance(node, ast.Return) and isinstance(node.value, ast.Constant | None):
            given = "nothing" if node.value is None else ast.unparse(node.value)
            yield at(
                node,
                f"{function.name} returns {given}",
                _UNANSWERED,
                "return the response, with its fields set",
            )


def _raises(program: Program, function: Function) -> Iterator[Finding]:
    for node in own_nodes(function):
        if isinstance(node, ast.Raise) and not _is_caught(program, node, function):
            yield at(
                node,
                "a raise in a service callback",
                _UNANSWERED,
                "say it in the response, as success and message, and return that",
            )


def _two_servers(program: Program) -> Iterator[Finding]:
    seen: set[str] = set()
    for call in program.made_by("create_service"):
        name = call.args[1] if len(call.args) > 1 else None
        if not isinstance(name, ast.Constant) or not isinstance(name.value, str):
            continue
        if name.value in seen:
            yield at(
                call,
                f"a second server of {name.value!r}",
                "both run each request in ROS 2, and the first answer counts",
                "give each a name of its own",
            )
        seen.add(name.value)


def _ends(body: Sequence[ast.stmt]) -> bool:
    """Whether the end of some statements is never reached."""
    return any(_leaves(statement) for statement in body)


def _leaves(node: ast.stmt) -> bool:
    found = False
    match node:
        case ast.Return() | ast.Raise():
            found = True
        case ast.If(body=body, orelse=other):
            found = _ends(body) and _ends(other)
        case ast.With(body=body) | ast.AsyncWith(body=body):
            found = _ends(body)
        case ast.Try(body=body, handlers=handlers, orelse=other, finalbody=final):
            tried = _ends(body) or _ends(other)
            found = _ends(final) or (tried and all(_ends(each.body) for each in handlers))
        case ast.While(test=ast.Constant(value=value), body=body):
            found = bool(value) and not any(isinstance(one, ast.Break) for one in _inner(body))
        case ast.Match(cases=cases):
            last = cases[-1]
            is_whole = isinstance(last.pattern, ast.MatchAs) and last.pattern.pattern is None
            found = is_whole and last.guard is None and all(_ends(each.body) for each in cases)
    return found


def _inner(body: Sequence[ast.stmt]) -> Iterator[ast.AST]:
    return (node for statement in body for node in ast.walk(statement))


def _is_caught(program: Program, node: ast.Raise, function: Function) -> bool:
    below: ast.AST = node
    for each in program.above(node):
        if isinstance(each, ast.Try) and below in each.body and each.handlers:
            return True
        if each is function:
            return False
        below = each
    return False
