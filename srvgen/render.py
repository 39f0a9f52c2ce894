"""One definition → the source of its Python module, one function a construct."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .errors import DefinitionError
from .fieldtypes import ROS1_TIME_TYPES
from .implied import implied_types, references
from .model import Constant, Definition, Field, FieldType, Kind, MessageDef, ServiceDef
from .render_check import checks
from .render_text import definition_literal, docstring, text_literal
from .render_types import (
    Scope,
    annotation,
    array_class,
    attribute,
    constant_annotation,
    default,
    default_constant,
    module_name,
    rosidl_type,
    scalar,
)
from .typehash import Resolve, hash_of

_INDENT = "    "
_STANDARD = ("builtins", "math", "typing")


@dataclass(frozen=True, slots=True)
class Import:
    """One nested message class that a module needs from another."""

    package: str
    kind: Kind
    name: str
    alias: str

    @property
    def full_name(self) -> str:
        """`geometry_msgs/msg/Point`."""
        return f"{self.package}/{self.kind}/{self.name}"

    @property
    def module(self) -> str:
        """The module that has the class: `geometry_msgs.msg._point`."""
        return f"{self.package}.{self.kind}.{module_name(self.name)}"

    def __str__(self) -> str:
        renamed = "" if self.alias == self.name else f" as {self.alias}"
        return f"from {self.module} import {self.name}{renamed}"


@dataclass(frozen=True, slots=True)
class Source:
    """A module's source; `header` only imports what `body` needs."""

    module: str
    imports: tuple[Import, ...]
    header: str
    body: str

    @property
    def text(self) -> str:
        """The whole file."""
        return f"{self.header}\n\n{self.body}"


def render(definition: Definition, resolve: Resolve, text: str) -> Source:
    """The module of one definition.

    Args:
        definition: what a file defines; what it implies is rendered with it.
        resolve: gives the definition of a full name, for the hashes of nested types.
        text: the definition's text with those of all nested types, kept in a service's class.

    Raises:
        DefinitionError: a nested type is not within reach, or a type is one of ROS 1's.
    """
    parts = [*implied_types(definition), definition]
    messages = [part for part in parts if isinstance(part, MessageDef)]
    _refuse_ros1(messages)
    imports = imports_of(definition)
    names = {one.full_name: one.alias for one in imports}
    scope = Scope(names | {message.full_name: message.name for message in messages})
    hashes = _hashes(parts, resolve)
    blocks = [_message(message, hashes[message.full_name], scope) for message in messages]
    if len(messages) < len(parts):
        blocks.append([f"_DEFINITION = {definition_literal(text)}"])
    blocks += [
        _namespace(part, hashes, names) for part in parts if not isinstance(part, MessageDef)
    ]
    body = "\n\n".join("\n".join(block) + "\n" for block in blocks)
    kind = definition.full_name.split("/")[1]
    module = f"{definition.package}.{kind}.{module_name(definition.name)}"
    return Source(module, imports, _header(definition, imports, body), body)


def imports_of(definition: Definition) -> tuple[Import, ...]:
    """The nested classes that a definition's module takes from other modules."""
    parts = [*implied_types(definition), definition]
    messages = [part for part in parts if isinstance(part, MessageDef)]
    types = {field.type.element for field in references(definition)}
    wanted = sorted((one.package or "", one.kind, one.base) for one in types)
    names = [name for _, _, name in wanted]
    # A class body sees its constants before the module's names.
    taken = {constant.name for message in messages for constant in message.constants}
    taken |= {part.name for part in parts}
    return tuple(
        Import(
            package,
            kind,
            name,
            f"_{package}_{name}" if name in taken or names.count(name) > 1 else name,
        )
        for package, kind, name in wanted
    )


def _refuse_ros1(messages: Sequence[MessageDef]) -> None:
    for message in messages:
        for field in message.fields:
            if field.type.base in ROS1_TIME_TYPES:
                raise DefinitionError(
                    f"field {field.name!r} of {message.full_name} has ROS 1's type "
                    f"{field.type.base!r}, which ROS 2 does not know",
                    line=field.line,
                    column=field.column,
                    hint=f"write {ROS1_TIME_TYPES[field.type.base]}",
                )


def _hashes(parts: Sequence[Definition], resolve: Resolve) -> dict[str, str]:
    own = {part.full_name: part for part in parts}

    def resolve_own_first(name: str) -> Definition:
        return own.get(name) or resolve(name)

    return {part.full_name: hash_of(part, resolve_own_first) for part in parts}


def _header(definition: Definition, imports: Sequence[Import], body: str) -> str:
    groups = [
        [f"import {name} as _{name}" for name in _STANDARD if _uses(body, name)],
        ["import msgspec as _msgspec"] if _uses(body, "msgspec") else [],
        [str(one) for one in imports],
        ["from .. import _runtime"],
    ]
    text = f'"""{definition.full_name}, generated by srvgen; do not edit."""\n# ruff: noqa\n'
    return text + "".join("\n" + "\n".join(group) + "\n" for group in groups if group)


def _uses(body: str, module: str) -> bool:
    return re.search(rf"\b_{module}\.", body) is not None


def _message(message: MessageDef, type_hash: str, scope: Scope) -> list[str]:
    scope = scope.inside(message)
    options = ", gc=False" if all(map(_is_flat, message.fields)) else ""
    return [
        f"class {message.name}(_runtime.{_base(message)}, kw_only=True{options}):",
        *docstring(_documentation(message.comment, message.full_name), _INDENT),
        "",
        *_facts(message, type_hash, scope),
        *_constants(message, scope),
        *_fields(message, scope),
        *_check(message, scope),
    ]


def _base(message: MessageDef) -> str:
    if any(attribute(field.name) != field.name for field in message.fields):
        return "RenamedMessage"
    # The others do without its metaclass, which slows the making of messages on Python 3.11.
    has_constants = message.constants or any(one.default is not None for one in message.fields)
    return "MessageWithConstants" if has_constants else "Message"


def _is_flat(field: Field) -> bool:
    return field.type.is_primitive and not field.type.is_array


def _documentation(comment: Sequence[str], fallback: str) -> list[str]:
    lines = [line.rstrip() for line in comment]
    while lines and not lines[0]:
        lines.pop(0)
    while lines and not lines[-1]:
        lines.pop()
    return lines or [fallback]


def _facts(message: MessageDef, type_hash: str, scope: Scope) -> list[str]:
    pairs = [f"({text_literal(one.name)}, {text_literal(str(one.type))})" for one in message.fields]
    types = [
        f"{text_literal(one.name)}: {text_literal(rosidl_type(one.type))}" for one in message.fields
    ]
    nested = [
        f"{text_literal(one.name)}: {scope.class_of(one.type)}"
        for one in message.fields
        if not one.type.is_primitive
    ]
    return [
        f"    _TYPE = {text_literal(message.full_name)}",
        f"    _HASH = {text_literal(type_hash)}",
        *_collection("_FIELDS", "()", pairs),
        *_collection("_fields_and_field_types", "{}", types),
        *(_collection("_NESTED", "{}", nested) if nested else ()),
        f"    _WIDTH = {len(message.fields)}",
    ]


def _collection(name: str, brackets: str, items: Sequence[str]) -> list[str]:
    if not items:
        return [f"    {name} = {brackets}"]
    if len(items) == 1 and brackets == "()":
        return [f"    {name} = ({items[0]},)"]
    lines = [f"        {item}," for item in items]
    return [f"    {name} = {brackets[0]}", *lines, f"    {brackets[1]}"]


def _constants(message: MessageDef, scope: Scope) -> list[str]:
    lines = [line for constant in message.constants for line in _constant(constant, scope)]
    for field in message.fields:
        if field.default is not None:
            name = f"{field.name.upper()}__DEFAULT"
            type_ = _default_annotation(field.type, scope)
            lines.append(f"    {name}: _typing.ClassVar[{type_}] = {default_constant(field)}")
    return ["", *lines] if lines else []


def _default_annotation(type_: FieldType, scope: Scope) -> str:
    if type_.is_array and not array_class(type_):
        return f"{scope.builtin('list')}[{constant_annotation(type_.base, scope)}]"
    return annotation(type_, scope) if type_.is_array else constant_annotation(type_.base, scope)


def _constant(constant: Constant, scope: Scope) -> list[str]:
    type_ = constant_annotation(constant.type, scope)
    value = scalar(constant.value, FieldType(constant.type))
    line = f"    {constant.name}: _typing.ClassVar[{type_}] = {value}"
    return [line, *_attribute_docstring(constant)]


def _fields(message: MessageDef, scope: Scope) -> list[str]:
    lines: list[str] = []
    documented = True
    for field in message.fields:
        text = _attribute_docstring(field)
        if documented or text:
            lines.append("")
        declared = f"    {attribute(field.name)}: {annotation(field.type, scope)}"
        lines += [f"{declared} = {default(field, scope)}", *text]
        documented = bool(text)
    return lines


def _attribute_docstring(documented: Field | Constant) -> list[str]:
    lines = _documentation(documented.comment, "")
    unit = documented.unit
    if unit and not any(f"[{unit}]" in line for line in lines):
        lines = [*(line for line in lines if line), f"Unit: {unit}"]
    return docstring(lines, _INDENT) if any(lines) else []


def _check(message: MessageDef, scope: Scope) -> list[str]:
    if not message.fields:
        return []
    statements = checks(message.fields, scope)
    return ["", "    def _check(self) -> None:", *(f"        {line}" for line in statements)]


def _namespace(part: Definition, hashes: Mapping[str, str], names: Mapping[str, str]) -> list[str]:
    is_service = isinstance(part, ServiceDef)
    return [
        f"class {part.name}(_runtime.{'Service' if is_service else 'Action'}):",
        f'    """{part.full_name}"""',
        "",
        f"    _TYPE = {text_literal(part.full_name)}",
        f"    _HASH = {text_literal(hashes[part.full_name])}",
        "    _DEFINITION = _DEFINITION",
        "",
        *(_service_members(part.name) if is_service else _action_members(part.name, names)),
    ]


def _service_members(name: str) -> list[str]:
    return [f"    {part} = {name}_{part}" for part in ("Request", "Response", "Event")]


def _action_members(name: str, names: Mapping[str, str]) -> list[str]:
    return [
        *(f"    {part} = {name}_{part}" for part in ("Goal", "Result", "Feedback")),
        "",
        "    class Impl:",
        '        """What the action is made of."""',
        "",
        f"        SendGoalService = {name}_SendGoal",
        f"        GetResultService = {name}_GetResult",
        f"        FeedbackMessage = {name}_FeedbackMessage",
        f"        CancelGoalService = {names['action_msgs/srv/CancelGoal']}",
        f"        GoalStatusMessage = {names['action_msgs/msg/GoalStatusArray']}",
    ]
