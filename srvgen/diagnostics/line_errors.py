"""All errors of one line that the parser has refused, with hints and repairs."""

from __future__ import annotations

from collections.abc import Iterator

from ..definitions.field_types import ROS1_TIME_TYPES, InvalidTypeName, parse_type
from ..definitions.literals import parse_default, parse_scalar
from ..definitions.model import PRIMITIVES, FieldType
from ..definitions.names import (
    CONSTANT_RULE,
    LOWER_RULE,
    first_invalid,
    is_constant_name,
    is_field_name,
)
from ..errors import InvalidText, Repair
from .line_hints import (
    bound_repair,
    bracket_repair,
    comment_repair,
    constant_name_hint,
    constant_name_repair,
    explain_value,
    extra_word,
    field_name_hint,
    field_name_repair,
    likely_value,
    line_hint,
    lone_type_hint,
    looks_like_separator,
    several_fields,
    strange_character,
)
from .type_hints import invalid_type_name, multiword_type, size_hint, type_hint


def errors_in_line(code: str, package: str) -> list[InvalidText]:
    """Every error of a line without its comment; offsets count in the line."""
    strange = strange_character(code)
    return [strange] if strange else list(_errors(code, package))


def _errors(code: str, package: str) -> Iterator[InvalidText]:
    type_text, _, rest = code.partition(" ")
    name = rest.lstrip()
    if not type_text:
        indent = len(code) - len(name)
        yield InvalidText(
            "expected the type at the start of the line, got white space",
            hint="only comments may be indented",
            repair=Repair(0, indent, ""),
        )
        yield from (one.moved(indent) for one in _errors(name, package))
    elif not name or looks_like_separator(code) or line_hint(code):
        yield _incomplete_line(code, package)
    elif whole := multiword_type(code) or extra_word(code) or several_fields(code):
        yield whole
    elif bound := bound_repair(code):
        message = f"expected no spaces in the type, got {code[: bound.end].rstrip()!r}"
        yield InvalidText(message, hint=f"did you mean {bound.text.rstrip()}?", repair=bound)
    elif (brackets := bracket_repair(code)) and not code.startswith(brackets.text):
        message = f"expected no spaces in the type, got {code[: brackets.end].rstrip()!r}"
        yield InvalidText(message, hint=f"did you mean {brackets.text.rstrip()}?", repair=brackets)
    elif "=" in name:
        yield from _constant_errors(code, type_text, len(code) - len(name), package)
    else:
        yield from _field_errors(code, type_text, len(code) - len(name), package)


def _incomplete_line(code: str, package: str) -> InvalidText:
    alone = "" if " " in code else " alone"
    message = f"expected a type and a name, got {code!r}{alone}"
    if looks_like_separator(code) or code == "---":
        if code.startswith("=" * 8):
            return InvalidText(message, hint=line_hint(code))
        return InvalidText(
            message,
            hint="a message has one section, a service (.srv) two, an action (.action) three, "
            "with a line of exactly --- between them",
        )
    hint = line_hint(code)
    if not hint:
        try:
            _read_type(code, package)
            hint = lone_type_hint(code)
        except InvalidText as error:
            hint = error.hint
    return InvalidText(message, hint=hint, repair=comment_repair(code))


def _constant_errors(
    code: str, type_text: str, name_at: int, package: str
) -> Iterator[InvalidText]:
    name, _, raw_value = code[name_at:].partition("=")
    name = name.rstrip()
    value = raw_value.lstrip()
    if type_text not in PRIMITIVES:
        if default := _default_with_equals(code, type_text, name_at, package):
            yield default
            return
        yield InvalidText(
            f"expected a plain built-in type for a constant, got {type_text!r}",
            hint="" if "=" in type_text or type_text in ROS1_TIME_TYPES else type_hint(type_text),
        )
    meant = likely_value(value, lambda text: parse_scalar(text, type_text)) or value
    if not is_constant_name(name):
        yield InvalidText(
            f"expected the name of a constant ({CONSTANT_RULE}), got {name!r}",
            name_at + first_invalid(name, "constant"),
            constant_name_hint(name, type_text, meant),
            constant_name_repair(name, name_at),
        )
        if name != name.upper() or not value:
            return  # the line may be a field with a default: the value need not fit a constant
    if type_text in PRIMITIVES:
        try:
            parse_scalar(value, type_text)
        except InvalidText as error:
            explained = explain_value(error, value, lambda text: parse_scalar(text, type_text))
            yield explained.moved(len(code) - len(value))


def _default_with_equals(
    code: str, type_text: str, name_at: int, package: str
) -> InvalidText | None:
    """The error of a default that is written with `=`, though only constants have one."""
    name, _, value = code[name_at:].partition("=")
    name, value = name.rstrip(), value.strip()
    try:
        field_type = parse_type(type_text, package)
    except InvalidText:
        return None
    if not is_field_name(name) or field_type.base in ROS1_TIME_TYPES:
        return None
    equals = code.index("=", name_at)
    if not field_type.is_primitive:
        return InvalidText(
            f"expected a field of the message type {field_type} without a default, "
            f"got {code[equals:]!r}",
            equals,
            f"a message uses the defaults of its own fields: {type_text} {name}",
        )
    meant = likely_value(value, lambda text: parse_default(text, field_type))
    right = f"{type_text} {name} {meant or value}".rstrip()
    return InvalidText(
        f"expected a default without '=', got {code[equals:]!r}",
        equals,
        f"did you mean {right}?" if meant or not value else "",
        Repair(0, len(code), right) if meant or not value else None,
    )


def _field_errors(code: str, type_text: str, name_at: int, package: str) -> Iterator[InvalidText]:
    name, _, rest = code[name_at:].partition(" ")
    default = rest.lstrip()
    field_type: FieldType | None = None
    try:
        field_type = _read_type(type_text, package)
    except InvalidText as error:
        yield _with_type_hint(error, code, type_text, name_at)
        if ("[" in type_text and "]" not in type_text) or name.rstrip(";,:") in PRIMITIVES:
            return  # type and name are swapped or split: one error is enough
    if not is_field_name(name):
        hint = field_name_hint(name, type_text)
        if is_constant_name(name) and default:
            hint = f"write a constant with '=': {type_text} {name}={default}"
        yield _invalid_field_name(name, name_at, hint, _name_repair(code, type_text, name, name_at))
    elif field_type and default:
        try:
            parse_default(default, field_type)
        except InvalidText as error:
            yield _with_default_hint(error, default, field_type).moved(len(code) - len(default))


def _read_type(text: str, package: str) -> FieldType:
    """Read a type. Raises InvalidText with a hint and a repair, if there are any."""
    try:
        return parse_type(text, package)
    except InvalidTypeName as error:
        raise invalid_type_name(error.text, error.package, error.name) from None


def _with_type_hint(error: InvalidText, code: str, type_text: str, name_at: int) -> InvalidText:
    name, _, default = code[name_at:].partition(" ")
    bare_type, bare = type_text.rstrip(":"), name.rstrip(";,:")
    if bare in PRIMITIVES and is_field_name(bare_type) and bare_type not in PRIMITIVES:
        error.hint = f"the type comes first: {bare} {bare_type}"
        swapped = Repair(0, name_at + len(name), f"{bare} {bare_type}")
        error.repair = None if default else swapped
    elif "[" in type_text and "]" not in type_text:
        error.repair = bracket_repair(code)
        if error.repair:
            error.hint = f"write it without spaces: {error.repair.text.rstrip()}"
    error.hint = error.hint or size_hint(type_text)
    return error


def _name_repair(code: str, type_text: str, name: str, name_at: int) -> Repair | None:
    if is_constant_name(name) and len(code) > name_at + len(name):
        return None  # either a constant without '=', or a field in capitals with a default
    if name.startswith("["):
        return bracket_repair(code)
    return field_name_repair(name, type_text, name_at)


def _invalid_field_name(name: str, name_at: int, hint: str, repair: Repair | None) -> InvalidText:
    return InvalidText(
        f"expected the name of a field ({LOWER_RULE}), got {name!r}",
        name_at + first_invalid(name, "field"),
        hint,
        repair,
    )


def _with_default_hint(error: InvalidText, default: str, field_type: FieldType) -> InvalidText:
    if looks_like_separator(default) or default == "---":
        error.hint = "write the separator --- on its own line"
        return error
    words = default.split()
    if not field_type.is_primitive:
        error.hint = "remove it: a message uses the defaults of its own fields"
    elif field_type.base in PRIMITIVES and is_field_name(words[-1]) and len(words) < 10:
        error.hint = "only a default may follow the name; write a second field on its own line"
    return explain_value(error, default, lambda text: parse_default(text, field_type))
