"""Renders the `_check` method of a message class; valid values need no function call."""

from __future__ import annotations

from collections.abc import Sequence

from ..definitions.model import Field, FieldType
from .render_expressions import (
    FLOATS,
    INTEGERS,
    STRINGS,
    Scope,
    array_class,
    attribute,
    text_literal,
)

_LONGEST = 92
"""The maximum length of a statement, so that a line in a method has at most 100 columns."""


def checks(fields: Sequence[Field], scope: Scope) -> list[str]:
    """The statements that convert each field to its exact type or raise FieldError."""
    float32_fields = [field for field in fields if str(field.type) == "float32"]
    # Only packing shows whether a float32 is valid, so all of them are packed in one call.
    joint = _check_float32s(float32_fields, scope) if len(float32_fields) > 1 else []
    others = [field for field in fields if not joint or field not in float32_fields]
    lines = [line for field in others for line in _check(field, scope)]
    return [part for line in [*joint, *lines] for part in _wrapped(line)]


def _wrapped(line: str) -> list[str]:
    if len(line) <= _LONGEST:
        return [line]
    indent = line[: len(line) - len(line.lstrip())]
    if line.startswith("if "):
        first, *others = line.removeprefix("if ").removesuffix(":").split(" or ")
        return ["if (", f"    {first}", *(f"    or {other}" for other in others), "):"]
    head, opening, call = line.partition("(")
    if not opening:
        return [line]
    arguments, _, rest = call.rpartition(")")  # `raise … from None` continues after the call
    return [f"{head}(", f"{indent}    {arguments}", f"{indent}){rest}"]


def _check_float32s(fields: Sequence[Field], scope: Scope) -> list[str]:
    values = [f"self.{attribute(field.name)}" for field in fields]
    return [
        f"pack, unpack = _runtime.float32s({len(fields)})",
        "try:",
        "    (",
        *(f"        {value}," for value in values),
        "    ) = unpack(",
        "        pack(",
        *(f"            {value}," for value in values),
        "        )",
        "    )",
        "except _runtime.NOT_FLOAT:",
        # Each is converted alone, so that the invalid one raises an error with its name.
        *(f"    {line}" for field in fields for line in _check_single(field, scope)),
    ]


def _check(field: Field, scope: Scope) -> list[str]:
    if not field.type.is_array:
        return _check_single(field, scope)
    target = f"self.{attribute(field.name)}"
    path = text_literal(field.name)
    bounds = "".join(f", {size}" for size in _sizes(field.type))
    if made := array_class(field.type):
        local = _local(field)
        return [
            f"{local} = {target}",
            f"if type({local}) is not {made}{_wrong_length(field.type, local)}:",
            f"    {target} = {made}.of({local}, {path}{bounds})",
        ]
    if not field.type.is_primitive:
        nested = scope.class_of(field.type)
        return [f"{target} = _runtime.to_messages({target}, {path}, {nested}{bounds})"]
    convert = _converter(field.type)
    return [f"{target} = _runtime.to_items({target}, {path}, {convert}{bounds})"]


def _check_single(field: Field, scope: Scope) -> list[str]:
    target = f"self.{attribute(field.name)}"
    path = text_literal(field.name)
    base = field.type.base
    if not field.type.is_primitive:
        return _check_nested(field, scope)
    if base == "float32":
        return [f"{target} = _runtime.to_float32({target}, {path})"]
    local = _local(field)
    # Without it, mypy reports that a value declared as bool cannot be of another type.
    declared = ": object" if base == "bool" else ""
    bound = f", {field.type.string_bound}" if field.type.string_bound is not None else ""
    return [
        f"{local}{declared} = {target}",
        f"if {_looks_wrong(field.type, local)}:",
        f"    {target} = _runtime.{_function(base)}({local}, {path}{bound})",
    ]


def _check_nested(field: Field, scope: Scope) -> list[str]:
    # Inline: one more call per level would cost as much as the checks themselves.
    local, path, expected = _local(field), text_literal(field.name), scope.class_of(field.type)
    return [
        f"{local} = self.{attribute(field.name)}",
        f"if type({local}) is not {expected}:",
        f"    _runtime.require_class({local}, {expected}, {path})",
        "try:",
        f"    {local}._check()",
        f"except {scope.builtin('ValueError')} as error:",
        f"    raise _runtime.with_prefix(error, {path}) from None",
    ]


def _looks_wrong(type_: FieldType, local: str) -> str:
    if type_.base in INTEGERS:
        name = INTEGERS[type_.base]
        bits = int(name.removeprefix("u").removeprefix("int"))
        low, high = ("0", bits) if name.startswith("u") else (f"-(2**{bits - 1})", bits - 1)
        return f"type({local}) is not int or not {low} <= {local} < 2**{high}"
    if type_.base in FLOATS:
        return f"type({local}) is not float"
    if type_.base == "byte":
        return f"type({local}) is not bytes or len({local}) != 1"
    if type_.base not in STRINGS:
        return f"type({local}) is not bool"
    too_long = "" if type_.string_bound is None else f" or len({local}) > {type_.string_bound}"
    return f"type({local}) is not str or not {local}.isascii(){too_long}"


def _local(field: Field) -> str:
    # Field names do not end in an underscore, so this hides neither `self` nor `type`.
    return f"{field.name}_"


def _function(base: str) -> str:
    if base in STRINGS:
        return "to_text"
    return "to_boolean" if base == "bool" else f"to_{INTEGERS.get(base, base)}"


def _converter(type_: FieldType) -> str:
    if type_.string_bound is None:
        return f"_runtime.{_function(type_.base)}"
    return f"_runtime.bounded_text({type_.string_bound})"


def _sizes(type_: FieldType) -> tuple[int, ...]:
    if type_.array_size is None:
        return ()
    return (type_.array_size if type_.is_fixed_array else 0, type_.array_size)


def _wrong_length(type_: FieldType, local: str) -> str:
    if type_.array_size is None:
        return ""
    sign = "!=" if type_.is_fixed_array else ">"
    return f" or len({local}) {sign} {type_.array_size}"
