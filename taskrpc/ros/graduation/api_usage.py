"""Calls, names and values that rclpy or ROS 2 rejects although taskrpc accepts them."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TypeAlias

from srvgen.definitions.model import Definition, FieldType, MessageDef, sections
from taskrpc.errors import TaskRpcError
from taskrpc.ros.colcon.programs import imports
from taskrpc.ros.graduation.program import (
    SPINS,
    Finding,
    Program,
    argument,
    called,
    dotted,
    finding_at,
    receiver,
)
from taskrpc.spi import names

Load: TypeAlias = Callable[[str], Definition | None]
"""Returns a definition by its full name, or None if there is none."""


# What only taskrpc has

_ENTITY = "callback_group event_callbacks qos_overriding_options"
_ARGUMENTS = {
    name: frozenset(known.split())
    for name, known in {
        "call": "request timeout_sec",
        "call_async": "request",
        "create_client": "srv_type srv_name qos_profile callback_group",
        "create_publisher": f"msg_type topic qos_profile publisher_class {_ENTITY}",
        "create_service": "srv_type srv_name callback qos_profile callback_group",
        "create_subscription": (
            f"msg_type topic callback qos_profile raw content_filter_options {_ENTITY}"
        ),
        "create_timer": "timer_period_sec callback callback_group clock autostart",
        "wait_for_service": "timeout_sec",
    }.items()
}
"""The arguments of rclpy's methods."""
_FIXES = {
    "exactly_once": "make the service idempotent, or put an id into a field of the request",
    "idempotent": "leave it out",
    "request_id": "put an id into a field of the request, so that the server recognises it",
    "retry": "repeat only idempotent calls: ROS 2 may have executed a request without a response",
    "timeout": "leave it out, and give spin_until_future_complete a timeout_sec",
}


_EXPERIMENTAL = "rclpy.experimental"


def taskrpc_only(program: Program) -> Iterator[Finding]:
    """Modules, arguments and options that ROS 2 does not have."""
    reported: set[ast.stmt] = set()
    for name, statement in imports(program.tree):
        if name.partition(".")[0] in ("taskrpc", "srvgen") and statement not in reported:
            reported.add(statement)
            yield finding_at(
                statement,
                f"{name} is imported",
                "ROS 2 does not have it: ModuleNotFoundError",
                "write it with rclpy and the interface packages",
            )
    if program.imports_rclpy:
        for call in program.calls:
            yield from _unknown_arguments(program, call)
        yield from _newer_names(program)
    yield from _json_options(program)


def _newer_names(program: Program) -> Iterator[Finding]:
    """Names that only the newest version of ROS 2 has."""
    for node in ast.walk(program.tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(_EXPERIMENTAL):
            used = any(alias.name == "AsyncNode" for alias in node.names)
        else:
            name = dotted(node) if isinstance(node, ast.Attribute) else ""
            used = name == f"{_EXPERIMENTAL}.AsyncNode"
        if used:
            yield finding_at(
                node,
                "AsyncNode is used",
                "it needs ROS 2 Lyrical or newer; older versions raise ImportError",
                "run it on ROS 2 Lyrical, or write it with rclpy.node.Node",
            )


def _unknown_arguments(program: Program, call: ast.Call) -> Iterator[Finding]:
    name = called(call)
    known = _ARGUMENTS.get(name)
    if known is None or (name.startswith("call") and receiver(call) not in program.clients):
        return
    for each in call.keywords:
        if each.arg is not None and each.arg not in known:
            yield finding_at(
                each,
                f"{name}({each.arg}=...)",
                "rclpy does not know the argument: TypeError",
                _FIXES.get(each.arg, "leave it out"),
            )


def _json_options(program: Program) -> Iterator[Finding]:
    for node in ast.walk(program.tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            words = node.value.split()
            if words == ["--json"] or {"ros2", "--json"} <= set(words):
                yield finding_at(
                    node,
                    "--json",
                    "the ros2 commands do not have this option",
                    "parse their YAML output, or use rclpy",
                )


# Start, end and names

_NAME_AT = {
    "create_client": (1, "srv_name", "service name"),
    "create_publisher": (1, "topic", "topic name"),
    "create_service": (1, "srv_name", "service name"),
    "create_subscription": (1, "topic", "topic name"),
}
"""The position, keyword and kind of the name that a method takes."""


def start_and_end(program: Program) -> Iterator[Finding]:
    """A missing `rclpy.init` or `rclpy.shutdown`."""
    spins = [call for call in program.calls if _is_rclpys(call, *SPINS)]
    if spins and not program.made_by("init"):
        yield finding_at(
            spins[0],
            "rclpy is used without rclpy.init()",
            "ROS 2 raises NotInitializedException",
            "call rclpy.init() first",
        )
    for call in program.calls:
        is_with = any(isinstance(each, ast.withitem) for each in program.above(call))
        if not _is_rclpys(call, "init") or is_with:
            continue
        if not program.made_by("shutdown") and not program.made_by("try_shutdown"):
            yield finding_at(
                call,
                "rclpy.init() without rclpy.shutdown()",
                "in ROS 2 other programs see the nodes until the process has ended",
                "call rclpy.shutdown() at the end, or write with rclpy.init():",
            )


def invalid_names(program: Program) -> Iterator[Finding]:
    """Names of nodes, services and topics that ROS 2 rejects."""
    for call in program.calls:
        name = called(call)
        if name in _NAME_AT:
            position, keyword, kind = _NAME_AT[name]
            given = argument(call, position, keyword)
            yield from _checked(given, partial(names.expand, node="node", kind=kind))
        elif name == "create_node" or _creates_node(program, call):
            yield from _checked(argument(call, 0, "node_name"), names.check_node_name)


def _checked(node: ast.expr | None, check: Callable[[str], object]) -> Iterator[Finding]:
    if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
        return
    try:
        check(node.value)
    except TaskRpcError as error:
        problem = str(error).splitlines()[0].removesuffix(":")
        yield finding_at(
            node, f"the name {node.value!r}", f"ROS 2 rejects it: {problem}", "rename it"
        )


def _creates_node(program: Program, call: ast.Call) -> bool:
    """Whether a call is `Node(...)`, or `super().__init__(...)` in a subclass of Node."""
    inner = call.func.value if isinstance(call.func, ast.Attribute) else None
    if dotted(call.func) in ("Node", "rclpy.node.Node"):
        return True
    home = next((each for each in program.above(call) if isinstance(each, ast.ClassDef)), None)
    is_node = home is not None and any(dotted(base).endswith("Node") for base in home.bases)
    is_super = isinstance(inner, ast.Call) and called(inner) == "super"
    return is_node and is_super and called(call) == "__init__"


def _is_rclpys(call: ast.Call, *wanted: str) -> bool:
    return dotted(call.func) in {f"rclpy.{name}" for name in wanted}


# Values of message fields

_INTEGERS = {
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "char": (0, 255),
}
_SECTIONS = {"Request": 0, "Response": 1, "Goal": 0, "Result": 1, "Feedback": 2}


def invalid_values(program: Program, load: Load) -> Iterator[Finding]:
    """Literals that a message field cannot hold: taskrpc reports them, ROS 2 may not."""
    types = _interface_names(program)
    for call in program.calls:
        fields = _fields(call.func, types, load)
        for each in call.keywords:
            if each.arg in fields:
                yield from _value(each.value, each.arg, fields[each.arg])
    yield from _assigned(program, types, load)


def _interface_names(program: Program) -> dict[str, str]:
    """The names that the program imports for interfaces, with the interfaces' full names."""
    found = {}
    for node in ast.walk(program.tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            package, _, kind = node.module.partition(".")
            if kind in ("msg", "srv", "action"):
                for alias in node.names:
                    found[alias.asname or alias.name] = f"{package}/{kind}/{alias.name}"
    return found


def _fields(node: ast.expr, types: Mapping[str, str], load: Load) -> dict[str, FieldType]:
    """The fields of the message class that an expression such as `AddTwoInts.Request` names."""
    name, _, section = dotted(node).partition(".")
    if name not in types or (section and section not in _SECTIONS):
        return {}
    definition = load(types[name])
    if definition is None or isinstance(definition, MessageDef) != (not section):
        return {}
    parts = list(sections(definition))
    index = _SECTIONS[section] if section else 0
    if index >= len(parts):
        return {}
    return {field.name: field.type for field in parts[index].fields}


def _assigned(program: Program, types: Mapping[str, str], load: Load) -> Iterator[Finding]:
    """Values that are assigned to fields of a message or of a service callback's response."""
    for callback in program.callbacks:
        arguments = callback.function.args.args
        given = callback.made.args[0] if callback.made.args else None
        if callback.kind == "create_service" and given is not None and len(arguments) >= 2:
            response = ast.Attribute(given, "Response")
            fields = _fields(response, types, load)
            yield from _assigned_in(callback.function, arguments[-1].arg, fields)
    for node in ast.walk(program.tree):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            fields = _fields(node.value.func, types, load)
            name = dotted(node.targets[0])
            if fields and name:
                yield from _assigned_in(program.function_of(node) or program.tree, name, fields)


def _assigned_in(scope: ast.AST, name: str, fields: Mapping[str, FieldType]) -> Iterator[Finding]:
    for node in ast.walk(scope):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                before, _, field = dotted(target).rpartition(".")
                if before == name and field in fields:
                    yield from _value(node.value, field, fields[field])


def _value(node: ast.expr, name: str, type_: FieldType) -> Iterator[Finding]:
    try:
        value = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return
    if type_.is_array or type(value) not in (int, float, str):
        return
    shown = f"{ast.unparse(node)} for the {type_} {name}"
    if type_.base in _INTEGERS:
        lowest, highest = _INTEGERS[type_.base]
        if not isinstance(value, int):
            yield finding_at(node, shown, "ROS 2 rejects it or changes it", "write an int")
        elif not lowest <= value <= highest:
            fix = f"use a value from {lowest} to {highest}"
            yield finding_at(node, shown, "ROS 2 rejects it, or wraps it around", fix)
    elif type_.base in ("float32", "float64") and not isinstance(value, float):
        fix = f"write {float(value)!r}" if isinstance(value, int) else "write a float"
        yield finding_at(node, shown, "ROS 2 rejects it or changes it", fix)
    elif type_.base in ("string", "wstring") and not isinstance(value, str):
        yield finding_at(node, shown, "ROS 2 rejects it", "write a string: str(...)")
    elif type_.base == "bool":
        fix = "write True or False"
        yield finding_at(node, shown, "ROS 2 rejects it, or takes it as true", fix)
