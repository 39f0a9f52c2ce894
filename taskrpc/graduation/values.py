"""Literals that a field of a message cannot hold, which taskrpc tells and ROS 2 does not."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping
from typing import TypeAlias

from srvgen.definitions.model import Definition, FieldType, MessageDef, sections
from taskrpc.graduation.program import Finding, Program, at, dotted

Load: TypeAlias = Callable[[str], Definition | None]
"""Gives a definition by its full name, None where there is none."""

_INTEGERS = {
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "char": (0, 255),
}
_SECTIONS = {"Request": 0, "Response": 1, "Goal": 0, "Result": 1, "Feedback": 2}


def values(program: Program, load: Load) -> Iterator[Finding]:
    """All of these in a program."""
    types = _types(program)
    for call in program.calls:
        fields = _fields(call.func, types, load)
        for each in call.keywords:
            if each.arg in fields:
                yield from _value(each.value, each.arg, fields[each.arg])
    yield from _assigned(program, types, load)


def _types(program: Program) -> dict[str, str]:
    """Names in the program that mean interfaces, and their full names."""
    found = {}
    for node in ast.walk(program.tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            package, _, kind = node.module.partition(".")
            if kind in ("msg", "srv", "action"):
                for alias in node.names:
                    found[alias.asname or alias.name] = f"{package}/{kind}/{alias.name}"
    return found


def _fields(node: ast.expr, types: Mapping[str, str], load: Load) -> dict[str, FieldType]:
    """The fields of the message that an expression such as `AddTwoInts.Request` means."""
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
    """Fields that are set later: of a request made before, of a service callback's response."""
    for callback in program.callbacks:
        arguments = callback.function.args.args
        given = callback.made.args[0] if callback.made.args else None
        if callback.kind == "create_service" and given is not None and len(arguments) >= 2:
            response = ast.Attribute(given, "Response")
            fields = _fields(response, types, load)
            yield from _set_in(callback.function, arguments[-1].arg, fields)
    for node in ast.walk(program.tree):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            fields = _fields(node.value.func, types, load)
            name = dotted(node.targets[0])
            if fields and name:
                yield from _set_in(program.function_of(node) or program.tree, name, fields)


def _set_in(scope: ast.AST, name: str, fields: Mapping[str, FieldType]) -> Iterator[Finding]:
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
            yield at(node, shown, "ROS 2 refuses it, or sends something else", "write an int")
        elif not lowest <= value <= highest:
            wraps = "ROS 2 refuses it, or wraps it around"
            yield at(node, shown, wraps, f"stay within {lowest} and {highest}")
    elif type_.base in ("float32", "float64") and not isinstance(value, float):
        fix = f"write {float(value)!r}" if isinstance(value, int) else "write a float"
        yield at(node, shown, "ROS 2 refuses it, or sends something else", fix)
    elif type_.base in ("string", "wstring") and not isinstance(value, str):
        yield at(node, shown, "ROS 2 refuses it", "write a text: str(...)")
    elif type_.base == "bool":
        yield at(node, shown, "ROS 2 refuses it, or takes it for true", "write True or False")
