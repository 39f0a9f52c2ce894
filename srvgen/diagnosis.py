"""Everything that is wrong with one line of a definition that the parser has refused."""

from __future__ import annotations

from collections.abc import Iterator

from .fieldtypes import ROS1_TIME_TYPES, parse_type
from .literals import parse_default, parse_scalar
from .mistake import Mistake, Repair
from .model import PRIMITIVES, FieldType
from .names import CONSTANT_RULE, LOWER_RULE, bad_at, is_constant_name, is_field_name
from .slips import (
    bracket_repair,
    comment_repair,
    constant_name_hint,
    constant_name_repair,
    field_name_hint,
    field_name_repair,
    line_hint,
    looks_like_separator,
    strange_character,
    type_hint,
)


def mistakes_in_line(code: str, package: str) -> list[Mistake]:
    """Every mistake of a line (its comment removed), with its offset in the line."""
    strange = strange_character(code)
    return [strange] if strange else list(_mistakes(code, package))


def _mistakes(code: str, package: str) -> Iterator[Mistake]:
    type_text, _, rest = code.partition(" ")
    name = rest.lstrip()
    if not type_text:
        yield Mistake(
            "expected the type at the start of the line, got white space",
            hint="only comments may be indented",
            repair=Repair(0, len(code) - len(code.lstrip()), ""),
        )
    elif not name or line_hint(type_text):
        yield from _lone_word(code)
    elif "=" in name:
        yield from _constant_mistakes(code, type_text, len(code) - len(name))
    else:
        yield from _field_mistakes(code, type_text, len(code) - len(name), package)


def _lone_word(code: str) -> Iterator[Mistake]:
    if (looks_like_separator(code) or code == "---") and not line_hint(code):
        yield Mistake(
            f"expected a type and a name, got {code!r}",
            hint="a message has one section; a service (.srv) two, an action (.action) three, "
            "with a line of exactly --- between them",
        )
        return
    alone = "" if " " in code else " alone"
    yield Mistake(
        f"expected a type and a name, got {code!r}{alone}",
        hint=line_hint(code),
        repair=comment_repair(code),
    )


def _constant_mistakes(code: str, type_text: str, name_at: int) -> Iterator[Mistake]:
    name, _, raw_value = code[name_at:].partition("=")
    name = name.rstrip()
    value = raw_value.lstrip()
    if type_text not in PRIMITIVES:
        yield Mistake(
            f"expected a plain built-in type for a constant, got {type_text!r}",
            hint="" if "=" in type_text or type_text in ROS1_TIME_TYPES else type_hint(type_text),
        )
    if not is_constant_name(name):
        yield Mistake(
            f"expected the name of a constant ({CONSTANT_RULE}), got {name!r}",
            name_at + bad_at(name, "constant"),
            constant_name_hint(name, type_text, value),
            constant_name_repair(name, name_at),
        )
    if type_text in PRIMITIVES:
        try:
            parse_scalar(value, type_text)
        except Mistake as mistake:
            yield mistake.moved(len(code) - len(value))


def _field_mistakes(code: str, type_text: str, name_at: int, package: str) -> Iterator[Mistake]:
    name, _, rest = code[name_at:].partition(" ")
    default = rest.lstrip()
    field_type: FieldType | None = None
    try:
        field_type = parse_type(type_text, package)
    except Mistake as mistake:
        if name in PRIMITIVES and is_field_name(type_text):
            mistake.hint = f"the type comes first: {name} {type_text}"
            swapped = Repair(0, name_at + len(name), f"{name} {type_text}")
            mistake.repair = None if default else swapped
        elif "[" in type_text and "]" not in type_text:
            mistake.repair = bracket_repair(code)
        yield mistake
        if ("[" in type_text and "]" not in type_text) or name in PRIMITIVES:
            return  # type and name do not stand where they should: say it once
    if not is_field_name(name):
        hint = field_name_hint(name, type_text)
        if is_constant_name(name) and default:
            hint = f"a constant is written with '=': {type_text} {name}={default}"
        yield _no_field_name(name, name_at, hint, _name_repair(code, type_text, name, name_at))
    elif field_type and default:
        try:
            parse_default(default, field_type)
        except Mistake as mistake:
            yield _with_default_hint(mistake, default).moved(len(code) - len(default))


def _name_repair(code: str, type_text: str, name: str, name_at: int) -> Repair | None:
    if is_constant_name(name) and len(code) > name_at + len(name):
        return None  # a constant that lacks its '=', or a field in capitals with a default
    if name.startswith("["):
        return bracket_repair(code)
    return field_name_repair(name, type_text, name_at)


def _no_field_name(name: str, name_at: int, hint: str, repair: Repair | None) -> Mistake:
    return Mistake(
        f"expected the name of a field ({LOWER_RULE}), got {name!r}",
        name_at + bad_at(name, "field"),
        hint,
        repair,
    )


def _with_default_hint(mistake: Mistake, default: str) -> Mistake:
    if default.startswith("//"):
        mistake.hint = "a comment begins with '#'"
        mistake.repair = comment_repair(default)
    if looks_like_separator(default) or default == "---":
        mistake.hint = "the separator --- stands on a line of its own"
    return mistake
