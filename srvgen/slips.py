"""What a writer most likely meant: hints for the usual slips, used only once a text is refused."""

from __future__ import annotations

import re
import unicodedata

from .mistake import Mistake, Repair
from .model import PRIMITIVES
from .names import camel_case, is_constant_name, is_field_name, is_message_name, snake_case

_MEANT = {
    "int": "int32",
    "integer": "int32",
    "long": "int64",
    "short": "int16",
    "uint": "uint32",
    "unsigned": "uint32",
    "float": "float32",
    "double": "float64",
    "boolean": "bool",
    "str": "string",
    "std::string": "string",
    "octet": "byte",
    "bytes": "byte[]",
    "time": "builtin_interfaces/Time",
    "duration": "builtin_interfaces/Duration",
    **{name: name for name in PRIMITIVES},
}
# Other languages do not agree on what these are, so only a hint is right.
_SEVERAL_MEANINGS = frozenset({"long", "bytes"})
_DASHES = "-\N{EM DASH}\N{EN DASH}\N{HYPHEN}\N{MINUS SIGN}\N{HORIZONTAL BAR}\N{FIGURE DASH}"
_SEPARATOR_LOOKALIKE = re.compile(rf"\s*(?:[{_DASHES}]\s*)+(?:#.*)?|\s*(?:=+|_+|\*+)\s*")
_BULLET = re.compile("\\s*[-*+\N{BULLET}\N{WHITE BULLET}\N{MIDDLE DOT}]\\s+|\\s*\N{BULLET}")
_SPACED_BRACKETS = re.compile(r"([A-Za-z]\w*(?:/\w+|<=\d+)?) *\[ *(<=)? *(\d*) *\] +(?=\S)")
CURLY = "\u201c\u201d\u201e\u2018\u2019"


def type_repair(text: str) -> Repair | None:
    """The only type that the unknown `text` can stand for, or None."""
    meant = _MEANT.get(text.lower(), text)
    if meant != text and text.lower() not in _SEVERAL_MEANINGS:
        return Repair(0, len(text), meant)
    parts = re.split(r"/|::|\.", text)
    if len(parts) == 3 and parts[1] == "msg":
        del parts[1]
    if len(parts) != 2 or not (is_field_name(parts[0]) and is_message_name(parts[1])):
        return None
    return Repair(0, len(text), "/".join(parts))


def bracket_repair(code: str) -> Repair | None:
    """The type that a line begins with, its brackets closed up to it, or None."""
    found = _SPACED_BRACKETS.match(code)
    if not found:
        return None
    base, bound, size = found.groups("")
    return Repair(0, found.end(), f"{base}[{bound}{size}] ")


def type_hint(text: str) -> str:
    """What the unknown type `text` was meant to be, or ""."""
    base, bracket, rest = text.partition("[")
    meant = _MEANT.get(base.lower())
    if meant and meant != base:
        return f"did you mean {meant.removesuffix('[]') if bracket else meant}{bracket}{rest}?"
    parts = re.split(r"/|::|\.", base)
    if len(parts) == 3 and parts[1] in ("msg", "srv", "action"):
        return f"in a definition the type is written {parts[0]}/{parts[2]}{bracket}{rest}"
    if len(parts) == 2 and is_field_name(parts[0].lower()) and is_message_name(parts[1]):
        parts[0] = snake_case(parts[0])
        return f"did you mean {parts[0]}/{parts[1]}{bracket}{rest}?"
    return _bracket_hint(base, text)


def _bracket_hint(base: str, text: str) -> str:
    if "<=" in base:
        return "only string and wstring have an upper bound; an array's is written [<=N]"
    if "[" in text and not text.endswith("]"):
        return "write the brackets of an array without spaces, for example int32[<=5]"
    return ""


def message_name_hint(name: str) -> str:
    """A valid name for a message that resembles `name`, or ""."""
    if not re.fullmatch("[A-Za-z0-9_]+", name):
        return ""
    meant = camel_case(name)
    return f"did you mean {meant}?" if meant != name and is_message_name(meant) else ""


def missing_type_repair(name: str) -> str:
    """What the bare type `name`, which its package does not have, can only mean, or ""."""
    if name == "Header":
        return "std_msgs/Header"
    meant = _MEANT.get(name.lower(), "")
    return "" if meant == name or name.lower() in _SEVERAL_MEANINGS else meant


def ros1_hint(name: str) -> str:
    """How ROS 2 writes a type that ROS 1 files have, or ""."""
    if name == "Header":
        return "ROS 2 writes std_msgs/Header"
    if name in ("time", "duration"):
        return f"ROS 2 writes {_MEANT[name]}"
    meant = _MEANT.get(name.lower(), name)
    return "" if meant == name else f"did you mean the built-in type {meant}?"


def field_name_hint(name: str, type_text: str) -> str:
    """What the refused field name was meant to be, or ""."""
    if "[" in name:
        bare, _, rest = name.partition("[")
        return f"the brackets belong to the type: {type_text}[{rest} {bare}"
    trimmed = name.rstrip(";,:")
    if trimmed != name and is_field_name(trimmed):
        return f"nothing follows the name: {type_text} {trimmed}"
    if not name.isascii():
        return "a name has the letters a to z only, without accents"
    meant = snake_case(name)
    return f"did you mean {meant}?" if meant != name and is_field_name(meant) else ""


def field_name_repair(name: str, type_text: str, name_at: int) -> Repair | None:
    """The only way to write the refused name of a field that stands at `name_at`, or None."""
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
    """The only way to write the refused name of a constant, or None.

    A name that is not in capitals has two: it may be a field whose default got a `=`.
    """
    meant = snake_case(name).upper()
    if name != name.upper() or meant == name or not is_constant_name(meant) or " " in name:
        return None
    return Repair(name_at, name_at + len(name), meant)


def comment_repair(code: str) -> Repair | None:
    """Another language's comment as one of ours, or None."""
    if code.startswith("//"):
        return Repair(0, 2, "#")
    if code.startswith("/*") and code.endswith("*/") and len(code) >= len("/**/"):
        return Repair(0, len(code), f"# {code[2:-2].strip()}")
    return None


def constant_name_hint(name: str, type_text: str, value: str) -> str:
    """What the refused name of a constant was meant to be, or ""."""
    if " " in name:
        return "a line with '=' anywhere, even in quotes, is read as a constant"
    meant = snake_case(name).upper() if name != name.lower() else name.upper().strip("_")
    if not is_constant_name(meant) or meant == name:
        return ""
    if is_field_name(name):
        return (
            f"a constant is in capitals: {type_text} {meant}={value}; "
            f"a field's default has no '=': {type_text} {name} {value}"
        )
    return f"did you mean {meant}?"


def looks_like_separator(line: str) -> bool:
    """Whether a line that is not `---` was meant to be."""
    return _SEPARATOR_LOOKALIKE.fullmatch(line) is not None and line != "---"


def separator_repair(line: str) -> Repair:
    """A line that was meant as the separator as one, its comment on a line of its own."""
    _, mark, comment = line.partition("#")
    return Repair(0, len(line), f"---\n#{comment}" if mark else "---")


def line_hint(code: str) -> str:
    """What a line that is no definition at all was meant to be, or ""."""
    if code.startswith(("//", "/*", "--", "%")):
        return "a comment begins with '#'"
    if code.startswith(("MSG:", "===")):
        return "these are several definitions in one; give each type a file of its own"
    if code.startswith("@"):
        return "annotations belong to .idl files; leave this line out"
    if "=" in code and is_constant_name(code.partition("=")[0]):
        return f"a constant begins with its type: int32 {code}"
    return ""


def strange_character(code: str) -> Mistake | None:
    """The first character that a word processor left in a line that is no definition."""
    bullet = _BULLET.match(code)
    if bullet:
        at = len(bullet[0]) - len(bullet[0].lstrip())
        return Mistake(
            f"expected a type at the start of the line, got a list's {code[at]!r}",
            at,
            "leave it out: one definition a line needs no list",
            Repair(0, bullet.end(), ""),
        )
    for offset, char in enumerate(code):
        if char in CURLY:
            return Mistake(
                f"expected plain text, got the curly quotation mark {char}",
                offset,
                "replace it by a straight one",
                Repair(offset, offset + 1, "'" if char in CURLY[-2:] else '"'),
            )
        if char != " " and unicodedata.category(char) in ("Cf", "Cc", "Zs"):
            name = unicodedata.name(char, "control character").lower()
            plain = " " if unicodedata.category(char) == "Zs" else ""
            return Mistake(
                f"expected plain text, got a {name} (U+{ord(char):04X})",
                offset,
                "replace it by a plain space or by nothing",
                Repair(offset, offset + 1, plain),
            )
    return None
