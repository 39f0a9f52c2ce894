"""Beginning and end of a program, and the names that it gives."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator

from taskrpc import names
from taskrpc.errors import TaskRpcError
from taskrpc.graduation.program import Finding, Program, argument, at, called, dotted

_NAME_AT = {
    "create_client": (1, "srv_name", "service name"),
    "create_publisher": (1, "topic", "topic name"),
    "create_service": (1, "srv_name", "service name"),
    "create_subscription": (1, "topic", "topic name"),
}
_SPINS = ("spin", "spin_once", "spin_until_future_complete")


def lifetime(program: Program) -> Iterator[Finding]:
    """All of these in a program."""
    yield from _begins(program)
    yield from _ends(program)
    for call in program.calls:
        yield from _names(program, call)


def _begins(program: Program) -> Iterator[Finding]:
    spins = [call for call in program.calls if _is_rclpys(call, *_SPINS)]
    if spins and not any(_begins_context(call) for call in program.calls):
        yield at(
            spins[0],
            "rclpy is used without rclpy.init()",
            "ROS 2 raises NotInitializedException",
            "call rclpy.init() first",
        )


def _ends(program: Program) -> Iterator[Finding]:
    for call in program.calls:
        is_with = any(isinstance(each, ast.withitem) for each in program.above(call))
        if not _is_rclpys(call, "init") or is_with:
            continue
        if not program.made_by("shutdown") and not program.made_by("try_shutdown"):
            yield at(
                call,
                "rclpy.init() without rclpy.shutdown()",
                "ROS 2 leaves nodes for others to see until the process has ended",
                "call rclpy.shutdown() at the end, or write with rclpy.init():",
            )


def _names(program: Program, call: ast.Call) -> Iterator[Finding]:
    name = called(call)
    if name in _NAME_AT:
        position, keyword, kind = _NAME_AT[name]
        given = argument(call, position, keyword)
        yield from _checked(given, lambda text: names.expand(text, node="node", kind=kind))
    elif name == "create_node" or _is_init_of_node(program, call):
        yield from _checked(argument(call, 0, "node_name"), names.check_node_name)


def _checked(node: ast.expr | None, check: Callable[[str], object]) -> Iterator[Finding]:
    if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
        return
    try:
        check(node.value)
    except TaskRpcError as error:
        problem = str(error).splitlines()[0].removesuffix(":")
        yield at(node, f"the name {node.value!r}", f"ROS 2 refuses it: {problem}", "rename it")


def _is_init_of_node(program: Program, call: ast.Call) -> bool:
    inner = call.func.value if isinstance(call.func, ast.Attribute) else None
    if dotted(call.func) in ("Node", "rclpy.node.Node"):
        return True
    home = next((each for each in program.above(call) if isinstance(each, ast.ClassDef)), None)
    is_node = home is not None and any(dotted(base).endswith("Node") for base in home.bases)
    is_super = isinstance(inner, ast.Call) and called(inner) == "super"
    return is_node and is_super and called(call) == "__init__"


def _begins_context(call: ast.Call) -> bool:
    return called(call) == "init" or _is_rclpys(call, "init")


def _is_rclpys(call: ast.Call, *wanted: str) -> bool:
    return dotted(call.func) in {f"rclpy.{name}" for name in wanted}
