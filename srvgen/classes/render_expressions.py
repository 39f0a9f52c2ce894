"""Renders the expressions of generated code: literals, docstrings, annotations and defaults."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Mapping, Sequence

from msgspec import Struct

from ..definitions.literals import unescape
from ..definitions.model import Field, FieldType, MessageDef, Scalar, Value
from ..definitions.names import snake_case

INTEGERS = {
    "char": "uint8",
    **{name: name for name in "int8 uint8 int16 uint16 int32 uint32 int64 uint64".split()},
}
"""The integer types, with the name of their converter and their array class."""

FLOATS = frozenset({"float32", "float64"})
STRINGS = frozenset({"string", "wstring"})

_BUILTINS = frozenset("bool int float str bytes list".split())
_RESERVED = frozenset({"get_fields_and_field_types"})

_WIDTH = 100


class Scope(Struct, frozen=True):
    """The names that the body of one generated class can use."""

    classes: Mapping[str, str]
    """The Python name of each class in the module, by its full name."""
    shadowed: frozenset[str] = frozenset()
    """Built-in names that fields of this class hide in its body."""

    def inside(self, message: MessageDef) -> Scope:
        """The same names in the body of this message's class."""
        return Scope(self.classes, _BUILTINS & {field.name for field in message.fields})

    def builtin(self, name: str) -> str:
        """The name of a built-in; a hidden one needs `import builtins as _builtins`."""
        is_hidden = name in self.shadowed or name in self.classes.values()
        return f"_builtins.{name}" if is_hidden else name

    def class_of(self, type_: FieldType) -> str:
        """The Python name of a nested message's class."""
        return self.classes[type_.full_name]


def attribute(name: str) -> str:
    """The attribute of a field: its name, with an underscore added if the name is reserved."""
    return f"{name}_" if keyword.iskeyword(name) or name in _RESERVED else name


def module_name(name: str) -> str:
    """The private module of an interface, named as in rosidl: `_add_two_ints` for `AddTwoInts`."""
    return f"_{snake_case(name)}"


def array_class(type_: FieldType) -> str | None:
    """The array class of a numeric array; None if the field is a list or not an array."""
    if not type_.is_array or not (type_.base in INTEGERS or type_.base in FLOATS):
        return None
    return f"_runtime.{INTEGERS.get(type_.base, type_.base).capitalize()}Array"


def annotation(type_: FieldType, scope: Scope) -> str:
    """The annotation of a field."""
    if array_class(type_):
        return "_runtime.Ints" if type_.base in INTEGERS else "_runtime.Floats"
    if type_.is_array:
        element = _annotation(type_, scope, scope.builtin("bytes"))
        return f"{scope.builtin('list')}[{element}]"
    return _annotation(type_, scope, "_runtime.Byte")


def _annotation(type_: FieldType, scope: Scope, byte: str) -> str:
    if not type_.is_primitive:
        return scope.class_of(type_)
    if type_.base in INTEGERS:
        return scope.builtin("int")
    if type_.base in FLOATS:
        return scope.builtin("float")
    if type_.base in STRINGS:
        return scope.builtin("str")
    return byte if type_.base == "byte" else scope.builtin("bool")


def constant_annotation(base: str, scope: Scope) -> str:
    """The annotation of a constant, or of a default as a class attribute."""
    return _annotation(FieldType(base), scope, scope.builtin("bytes"))


def default(field: Field, scope: Scope) -> str:
    """The expression after the `=` of a field."""
    type_ = field.type
    if made := array_class(type_):
        size = type_.array_size if type_.is_fixed_array else None
        return f"{made}.field({_elements(field.default, type_) or size or ''})"
    if type_.is_array:
        return f"_msgspec.field(default_factory={_list_factory(field, scope)})"
    if not type_.is_primitive:
        return f"_msgspec.field(default_factory={scope.class_of(type_)})"
    value = scalar(_zero(type_) if field.default is None else field.default, type_)
    return f"_runtime.byte({value})" if type_.base == "byte" else value


def default_constant(field: Field) -> str:
    """The value of `FIELD__DEFAULT`."""
    elements = _elements(field.default, field.type)
    if made := array_class(field.type):
        return f"{made}({elements})"
    if elements:
        return f"[{elements[1:-1].rstrip(',')}]"
    assert field.default is not None
    return scalar(field.default, field.type)


def scalar(value: Value, type_: FieldType) -> str:
    """The source of one literal of this type."""
    assert not isinstance(value, tuple)
    if type_.base == "byte":
        return literal(bytes((int(value),)))
    return literal(_as_declared(value, type_.base))


def _as_declared(value: Scalar, base: str) -> Scalar:
    if isinstance(value, str):
        return unescape(value)
    # The default of a float may be written as 1; the attribute must be a float.
    return float(value) if base in FLOATS else value


def _elements(value: Value | None, type_: FieldType) -> str:
    if not isinstance(value, tuple):
        return ""
    parts = ", ".join(scalar(item, type_) for item in value)
    return f"({parts},)" if len(value) == 1 else f"({parts})"


def _list_factory(field: Field, scope: Scope) -> str:
    type_ = field.type
    if elements := _elements(field.default, type_):
        return f"lambda: [{elements[1:-1].rstrip(',')}]"
    if not type_.is_fixed_array:
        return scope.builtin("list")
    if type_.is_primitive:
        return f"lambda: [{scalar(_zero(type_), type_)}] * {type_.array_size}"
    return f"lambda: [{scope.class_of(type_)}() for _ in range({type_.array_size})]"


def _zero(type_: FieldType) -> Scalar:
    if type_.base in STRINGS:
        return ""
    if type_.base in FLOATS:
        return 0.0
    return False if type_.base == "bool" else 0


def literal(value: Scalar | bytes) -> str:
    """The source of a value; infinity and nan need `import math as _math`."""
    if isinstance(value, str):
        return text_literal(value)
    if isinstance(value, bytes):
        return f'b"\\x{value[0]:02x}"'
    if isinstance(value, float) and not math.isfinite(value):
        return "_math.nan" if math.isnan(value) else f"{'-' if value < 0 else ''}_math.inf"
    return repr(value)


def text_literal(text: str) -> str:
    """The source of a string, in double quotes."""
    return '"' + _escaped(text).replace('"', '\\"') + '"'


def definition_literal(text: str) -> str:
    """The source of a long text, one line of it on each line of the source."""
    lines = [f"    {text_literal(line)}" for line in text.splitlines(keepends=True)]
    return "\n".join(["(", *lines, ")"]) if len(lines) > 1 else text_literal(text)


def docstring(lines: Sequence[str], indent: str) -> list[str]:
    """The lines as a docstring statement."""
    body = [_docstring_line(line) for line in lines]
    if len(body) == 1 and len(indent) + len(body[0]) + 6 <= _WIDTH:
        return [f'{indent}"""{body[0]}"""']
    rest = [(indent + line).rstrip() for line in body[1:]]
    return [f'{indent}"""{body[0]}', *rest, f'{indent}"""']


def _docstring_line(line: str) -> str:
    text = _escaped(line.rstrip())
    return text.replace('"', '\\"') if '"""' in text or text.endswith('"') else text


def _escaped(text: str) -> str:
    # Security: a definition must not be able to end a literal, and invisible characters must not
    # make the source look different in an editor. So all unprintable characters are escaped.
    text = text.replace("\\", "\\\\").replace("\n", "\\n")
    return text if text.isprintable() else re.sub("[^ -~]", _escaped_character, text)


def _escaped_character(match: re.Match[str]) -> str:
    char = match[0]
    return char if char.isprintable() else char.encode("unicode_escape").decode()
