"""Recognises the usual mistakes in names, values and lines, and suggests the correct text."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterator

from ..definitions.literals import CURLY
from ..definitions.names import is_constant_name, is_field_name, is_message_name, snake_case
from ..errors import InvalidText, Repair

_DASHES = "-\N{EM DASH}\N{EN DASH}\N{HYPHEN}\N{MINUS SIGN}\N{HORIZONTAL BAR}\N{FIGURE DASH}"
_SEPARATOR_LOOKALIKE = re.compile(rf"\s*(?:[{_DASHES}]\s*)+(?:#.*)?|\s*(?:=+|_+|\*+)\s*")
_BULLET = re.compile("\\s*[-*+\N{BULLET}\N{WHITE BULLET}\N{MIDDLE DOT}]\\s+|\\s*\N{BULLET}")
_SPACED_BRACKETS = re.compile(
    r"([A-Za-z]\w*(?:/\w+|<=\d+)?) *\[ *(?:(<=) *)?(?:(\d+) *)?\] +(?=\S)"
)
_SPACED_BOUND = re.compile(r"(w?string) *(<) *(=) *(\d+) +(?=\S)")
_TYPE_SHAPE = re.compile(r"[A-Za-z][\w/]*(?:<=\d+)?(?:\[(?:<=)?\d*\])?")
_FOREIGN_COMMENT = re.compile(r"(?<=\s)//")
_MODIFIERS = ("const", "constexpr", "static", "final", "required", "optional", "public", "private")
_OTHER_DECLARATIONS = re.compile(
    r"(?:message|struct|class|service|interface|enum|namespace|module|union|typedef|import|from|"
    r"package|using|syntax|def|rpc|type|action|msg|srv)\b.*"
)
_SECTION_TITLE = re.compile(r"(?:request|response|goal|result|feedback)s?\s*:", re.I)
_HINTS_BY_PREFIX = {
    ("//", "/*", "*/", "--", "%", "<!--", '"""'): "write comments with '#'",
    ("MSG:", "=" * 8): "this file contains several definitions; put each type into its own file",
    ("@",): "annotations are for .idl files only; remove this line",
}
_EXAMPLE_VALUES = {"bool": "true", "string": '"text"', "wstring": '"text"'}

_SUFFIXED = re.compile(r"([-+]?(?:0x[0-9a-f]+|[\d.]+(?:e[-+]?\d+)?))(?:f|l|u|ul|ll|ull)", re.I)
_WHOLE = re.compile(r"([-+]?\d+)\.0*")
_BOOLEAN_WORDS = {"yes": "true", "on": "true", "no": "false", "off": "false"}

Parse = Callable[[str], object]
"""Reads a value of one type, or raises InvalidText."""


def bracket_repair(code: str) -> Repair | None:
    """Remove the spaces between the type and its brackets at the start of a line, or None."""
    found = _SPACED_BRACKETS.match(code)
    if not found:
        return None
    base, bound, size = found.groups("")
    return Repair(0, found.end(), f"{base}[{bound}{size}] ")


def bound_repair(code: str) -> Repair | None:
    """Remove the spaces in a bounded string type at the start of a line, or None."""
    found = _SPACED_BOUND.match(code)
    if not found or " " not in found[0].rstrip():
        return None
    return Repair(0, found.end(), f"{''.join(found.groups())} ")


def extra_word(code: str) -> InvalidText | None:
    """The error of a line that begins with a modifier of another language, such as `const`."""
    word, _, rest = code.partition(" ")
    rest = rest.lstrip()
    if word == "repeated" and " " in rest:
        type_text, _, name = rest.partition(" ")
        meant = f"{type_text}[] {name.lstrip()}"
        return InvalidText(
            "expected a type at the start of the line, got 'repeated'",
            hint=f"write an array with brackets: {meant}",
            repair=Repair(0, len(code), meant),
        )
    if word not in _MODIFIERS or " " not in rest:
        return None
    why = {"const": "a line with '=' is a constant", "optional": "every field is always present"}
    return InvalidText(
        f"expected a type at the start of the line, got {word!r}",
        hint=f"remove it{': ' + why[word] if word in why else ''}",
        repair=Repair(0, len(code) - len(rest), ""),
    )


def several_fields(code: str) -> InvalidText | None:
    """The error of a line with several fields, separated by `,` or `;`."""
    code = _FOREIGN_COMMENT.split(code, maxsplit=1)[0].rstrip()
    first, *others = re.split("[,;]", code.rstrip(";, "))
    type_text, _, name = first.partition(" ")
    parts = [(type_text, name.strip())]
    for other in others:
        *kind, name = other.split() or [""]
        parts.append((kind[0] if kind else type_text, name))
        if len(kind) > 1 or not _TYPE_SHAPE.fullmatch(parts[-1][0]):
            return None
    if not others or not all(is_field_name(name) for _, name in parts):
        return None
    lines = [" ".join(part) for part in parts]
    return InvalidText(
        f"expected one field per line, got {len(lines)}",
        len(first),
        f"write each on its own line: {lines[0]}, then {', then '.join(lines[1:])}",
        Repair(0, len(code), "\n".join(lines)),
    )


def field_name_hint(name: str, type_text: str) -> str:
    """A hint for an invalid field name, or ""."""
    if name.startswith("["):
        return f"write the brackets directly after the type: {type_text}{name}"
    if "[" in name:
        bare, _, rest = name.partition("[")
        return f"write the brackets after the type: {type_text}[{rest} {bare}"
    trimmed = name.rstrip(";,:")
    if trimmed != name and is_field_name(trimmed):
        return f"remove what follows the name: {type_text} {trimmed}"
    if not name.isascii():
        return "a name may contain only the letters a to z, without accents"
    meant = snake_case(name)
    return f"did you mean {meant}?" if meant != name and is_field_name(meant) else ""


def field_name_repair(name: str, type_text: str, name_at: int) -> Repair | None:
    """The only valid spelling of an invalid field name at the offset `name_at`, or None."""
    bare, bracket, rest = name.partition("[")
    if bracket:
        if not is_field_name(bare) or not re.fullmatch(r"(?:<=)?\d*\]", rest):
            return None
        return Repair(0, name_at + len(name), f"{type_text}[{rest} {bare}")
    meant = name.rstrip(";,:")
    meant = snake_case(meant) if meant.isascii() else meant
    if meant == name or not is_field_name(meant):
        return None
    return Repair(name_at, name_at + len(name), meant)


def constant_name_repair(name: str, name_at: int) -> Repair | None:
    """The only valid spelling of an invalid constant name, or None.

    A name that is not in capitals has two: it may be a field whose default has a `=`.
    """
    meant = snake_case(name).upper()
    if name != name.upper() or meant == name or not is_constant_name(meant) or " " in name:
        return None
    return Repair(name_at, name_at + len(name), meant)


def comment_repair(code: str) -> Repair | None:
    """Write a comment of another language with `#`, or None."""
    if code.startswith("//"):
        return Repair(0, 2, "#")
    if code.startswith("/*") and code.endswith("*/") and len(code) >= len("/**/"):
        return Repair(0, len(code), f"# {code[2:-2].strip()}")
    return None


def constant_name_hint(name: str, type_text: str, value: str) -> str:
    """A hint for an invalid constant name, or ""; `value` is the valid value."""
    bounded = name.removesuffix("<").rstrip()
    if name.endswith("<") and type_text in ("string", "wstring") and is_field_name(bounded):
        return f"a bound belongs to the type: {type_text}<={value} {bounded}"
    if " " in name:
        return "a line with '=' is read as a constant, even if the '=' is in quotes"
    value = value or _EXAMPLE_VALUES.get(type_text, "0")
    if not name:
        return f"the name is missing: {type_text} NAME={value}"
    meant = snake_case(name) if is_field_name(snake_case(name)) else name
    if not is_constant_name(meant.upper()):
        return ""
    if name == name.upper():
        return f"did you mean {meant.upper()}?" if meant.upper() != name else ""
    default = f"a field's default has no '=': {type_text} {meant} {value}"
    return f"constants are in capitals: {type_text} {meant.upper()}={value}; {default}"


def looks_like_separator(line: str) -> bool:
    """Whether a line resembles the separator `---` without being it."""
    return _SEPARATOR_LOOKALIKE.fullmatch(line) is not None and line != "---"


def separator_repair(line: str) -> Repair:
    """Replace a line by the separator; a comment moves to the next line."""
    _, mark, comment = line.partition("#")
    return Repair(0, len(line), f"---\n#{comment}" if mark else "---")


def line_hint(code: str) -> str:
    """A hint for a line that is neither a field nor a constant, or ""."""
    for beginnings, hint in _HINTS_BY_PREFIX.items():
        if code.startswith(beginnings):
            return hint
    if code.strip("{}();, ") == "":
        return "definitions have no enclosing brackets; remove this line"
    if _SECTION_TITLE.fullmatch(code):
        return "sections have no titles, only a line --- between them; remove this line"
    if _OTHER_DECLARATIONS.fullmatch(code) and not is_field_name(code.rpartition(" ")[2]):
        return "a definition contains only fields and constants; remove this line"
    if "=" in code and is_constant_name(code.partition("=")[0].rstrip()):
        return f"write the type first: int32 {code}"
    return ""


def lone_type_hint(text: str) -> str:
    """A hint for a line that contains only a type."""
    bare = re.split(r"[<\[]", text)[0].rpartition("/")[2]
    name = snake_case(bare) if is_message_name(bare) else "value"
    return f"the name is missing: {text} {name if is_field_name(name) else 'value'}"


def strange_character(code: str) -> InvalidText | None:
    """The error of the first character that a word processor has put into a line, or None."""
    bullet = _BULLET.match(code)
    if bullet:
        at = len(bullet[0]) - len(bullet[0].lstrip())
        return InvalidText(
            f"expected a type at the start of the line, got a list's {code[at]!r}",
            at,
            "remove it: definitions need no list marks",
            Repair(0, bullet.end(), ""),
        )
    for offset, char in enumerate(code):
        if char in CURLY:
            return InvalidText(
                f"expected plain text, got the curly quotation mark {char}",
                offset,
                "replace it with a straight one",
                Repair(offset, offset + 1, "'" if char in CURLY[-2:] else '"'),
            )
        if char != " " and unicodedata.category(char) in ("Cf", "Cc", "Zs"):
            name = unicodedata.name(char, "control character").lower()
            plain = " " if unicodedata.category(char) == "Zs" else ""
            return InvalidText(
                f"expected plain text, got a {name} (U+{ord(char):04X})",
                offset,
                "remove it or replace it with a space",
                Repair(offset, offset + 1, plain),
            )
    return None


def explain_value(error: InvalidText, text: str, parse: Parse) -> InvalidText:
    """Add a hint and a repair to the error of the value `text`, if there are any.

    Args:
        error: the error that `parse` has raised for the text.
        text: the value, up to the end of the line.
        parse: reads a value of the right type, or raises InvalidText.
    """
    comment = re.search(r"(?:^|(?<=\s))//", text)
    if comment:
        error.hint = "write comments with '#'"
        if _reads(text[: comment.start()].rstrip(), parse) or not comment.start():
            error.repair = Repair(comment.start(), comment.end(), "#")
    elif not text:
        error.hint = "the value is missing"
    elif not error.repair and (meant := likely_value(text, parse)) not in ("", text):
        error.hint = f"did you mean {meant}?"
        # Only the author knows whether yes is a boolean or a text.
        error.repair = None if meant in _BOOLEAN_WORDS.values() else Repair(0, len(text), meant)
    return error


def likely_value(text: str, parse: Parse) -> str:
    """The value if it is valid, else the first likely replacement, or ""."""
    return next((one for one in _candidates(text) if _reads(one, parse)), "")


def _candidates(text: str) -> Iterator[str]:
    yield text
    bare = text.rstrip(";, ")
    yield bare
    yield _BOOLEAN_WORDS.get(bare.lower(), "")
    for pattern in (_SUFFIXED, _WHOLE):
        if found := pattern.fullmatch(bare):
            yield found[1]
    if re.fullmatch(r"\d+,\d+", bare):
        yield bare.replace(",", ".")
    inner = bare[1:-1] if bare[:1] + bare[-1:] in ("{}", "()") else bare
    if not re.search("[]['\"]", inner):
        yield f"[{inner}]"


def _reads(text: str, parse: Parse) -> bool:
    if not text:
        return False
    try:
        parse(text)
    except InvalidText:
        return False
    return True
