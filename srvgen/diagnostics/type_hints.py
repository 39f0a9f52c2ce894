"""Recognises types of other languages and misspelt types, and suggests the type of ROS 2."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..definitions.model import PRIMITIVES
from ..definitions.names import (
    LOWER_RULE,
    MESSAGE_RULE,
    camel_case,
    first_invalid,
    is_field_name,
    is_message_name,
    is_one_typo,
    is_package_name,
    snake_case,
)
from ..errors import InvalidText, Repair

_EQUIVALENTS = {
    "int": "int32",
    "integer": "int32",
    "long": "int64",
    "short": "int16",
    "uint": "uint32",
    "unsigned": "uint32",
    "size_t": "uint64",
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
    **{f"{name}_t": name for name in PRIMITIVES if "int" in name},
    **{f"i{bits}": f"int{bits}" for bits in (8, 16, 32, 64)},
    **{f"u{bits}": f"uint{bits}" for bits in (8, 16, 32, 64)},
    **{f"f{bits}": f"float{bits}" for bits in (32, 64)},
}
# Languages disagree about the size of these types, so they get a hint but no repair.
_AMBIGUOUS = frozenset({"long", "bytes", "size_t"})
_COMMON_MESSAGES = {
    name.rpartition("/")[2].lower(): name
    for name in (
        "std_msgs/Header geometry_msgs/Point geometry_msgs/Pose geometry_msgs/PoseStamped "
        "geometry_msgs/Quaternion geometry_msgs/Transform geometry_msgs/Twist "
        "geometry_msgs/Vector3 nav_msgs/Odometry nav_msgs/Path sensor_msgs/Image "
        "sensor_msgs/LaserScan sensor_msgs/PointCloud2"
    ).split()
}
"""Well-known messages by their lower-case names, which authors often write without the package."""
_BUILT_IN_SHAPES = {
    re.compile(r"u?int\d*", re.I): "int8 to int64 and uint8 to uint64",
    re.compile(r"(?:float|double)\d*", re.I): "float32 and float64",
}
_CONTAINER = re.compile(
    r"(?:std::)?(?:vector|list|array|sequence|set|tuple|optional)\s*[<\[](\w[\w:/]*)"
    r"(?:,\s*(\d+))?[>\]]",
    re.I,
)
_WORDS = {
    re.compile(r"unsigned char"): ("uint8", True),
    re.compile(r"(?:unsigned short|short unsigned)(?: int)?"): ("uint16", True),
    re.compile(r"(?:unsigned int|int unsigned)"): ("uint32", True),
    re.compile(r"(?:unsigned long long|long long unsigned)(?: int)?"): ("uint64", True),
    re.compile(r"unsigned long(?: int)?"): ("uint64", False),
    re.compile(r"signed char"): ("int8", True),
    re.compile(r"(?:signed )?short int"): ("int16", True),
    re.compile(r"signed int"): ("int32", True),
    re.compile(r"(?:signed )?long long(?: int)?"): ("int64", True),
    re.compile(r"(?:signed )?long int"): ("int64", False),
    re.compile(r"long double"): ("float64", False),
}
"""Types of C with several words: the type of ROS 2, and whether all compilers agree on it."""
_ARRAY_WORDS = frozenset("array arrays list set sequence tuple vector".split())
_MAPPINGS = frozenset("any dict dictionary json map mapping object record struct".split())


def invalid_type_name(text: str, owner: str, name: str) -> InvalidText:
    """The error of a message type whose package `owner` or name `name` is not valid."""
    if "/" in owner or not owner:
        return InvalidText(
            f"expected a built-in type, 'Name' or 'package/Name', got {text!r}",
            hint=type_hint(text),
            repair=type_repair(text),
        )
    if "/" in text and not is_package_name(owner):
        return InvalidText(
            f"expected a package name ({LOWER_RULE}) before the '/', got {owner!r}",
            first_invalid(owner, "field"),
            hint=type_hint(text),
        )
    hint = type_hint(text)
    # A built-in type of another language is wrong as a whole: point to its start.
    inside = 0 if hint else first_invalid(name, "message")
    return InvalidText(
        f"expected a built-in type or the name of a message ({MESSAGE_RULE}), got {name!r}",
        len(text) - len(name) + inside,
        hint or message_name_hint(name),
        type_repair(text),
    )


def type_repair(text: str) -> Repair | None:
    """The only type that the invalid type `text` can mean, or None."""
    meant = _EQUIVALENTS.get(text.lower(), text)
    if meant != text and text.lower() not in _AMBIGUOUS:
        return Repair(0, len(text), meant)
    plain = _plain_path(text)
    return Repair(0, len(text), plain) if plain and plain != text else None


def type_hint(text: str) -> str:
    """A hint for the invalid type `text`, or ""."""
    if container := _container(text):
        return container
    base, bracket, rest = text.partition("[")
    tail = bracket + rest
    if meant := _EQUIVALENTS.get(base.lower()):
        if meant == base:
            return ""
        return f"did you mean {meant.removesuffix('[]') if bracket else meant}{tail}?"
    parts = re.split(r"/|::|\.", base)
    if len(parts) == 3 and parts[1] in ("msg", "srv", "action"):
        return f"in a definition the type is written {parts[0]}/{parts[2]}{tail}"
    if plain := _plain_path(base) or _lower_path(base):
        return f"did you mean {plain}{tail}?"
    return _bracket_hint(base, text) or _similar_hint(base, tail)


def multiword_type(code: str) -> InvalidText | None:
    """The error of a line that begins with a type of C with several words, or None."""
    for pattern, (meant, is_sure) in _WORDS.items():
        found = re.match(rf"(?:{pattern.pattern}) +(?=[A-Za-z_])", code)
        if found:
            text = found[0].rstrip()
            return InvalidText(
                f"expected one word as the type, got {text!r}",
                hint=f"did you mean {meant}?",
                repair=Repair(0, len(text), meant) if is_sure else None,
            )
    return None


def message_name_hint(name: str) -> str:
    """A hint with a valid message name that resembles `name`, or ""."""
    if not re.fullmatch("[A-Za-z0-9_]+", name):
        return ""
    meant = camel_case(name)
    return f"did you mean {meant}?" if meant != name and is_message_name(meant) else ""


def replacements(name: str) -> list[str]:
    """The types that the missing type `name` may mean, the most likely first."""
    if name == "Header":
        return ["std_msgs/Header"]
    meant = _EQUIVALENTS.get(name.lower(), "")
    if not meant or meant == name:
        return []
    # std_msgs wraps every built-in type in a message, which may be what was meant.
    if name.lower() != meant or meant == "wstring":
        return [meant]
    return [meant, f"std_msgs/{meant.capitalize().replace('Uint', 'UInt')}"]


def ros1_hint(name: str) -> str:
    """A hint for a type that only ROS 1 has."""
    return f"ROS 2 writes {replacements(name)[0]}"


def missing_type_hint(name: str, elsewhere: Sequence[str]) -> str:
    """A hint for the missing type `name`; `elsewhere` has messages of this name."""
    meant = replacements(name)
    if meant and "/" in meant[0]:
        return ros1_hint(name)
    return suggest([*meant, *(one for one in elsewhere if one not in meant)][:3])


def missing_type_repair(name: str) -> str:
    """The only type that the missing type `name` can mean, or ""."""
    meant = replacements(name)
    return meant[0] if len(meant) == 1 and name.lower() not in _AMBIGUOUS else ""


def suggest(names: Sequence[str]) -> str:
    """A hint that offers these names, or "" if there are none."""
    return f"did you mean {' or '.join(names)}?" if names else ""


def _plain_path(text: str) -> str:
    """Write `geometry_msgs::msg::Point` and similar paths as definitions do, or ""."""
    parts = re.split(r"/|::|\.", text)
    if len(parts) == 3 and parts[1] == "msg":
        del parts[1]
    if len(parts) == 3 and parts[2] == "msg":
        del parts[2]  # the file name extension
    if len(parts) != 2 or not (is_field_name(parts[0]) and is_message_name(parts[1])):
        return ""
    return "/".join(parts)


def _lower_path(text: str) -> str:
    """Write `Geometry-Msgs/point` with valid names, or ""."""
    package, slash, name = text.partition("/")
    package, meant = snake_case(package), camel_case(name)
    known = _COMMON_MESSAGES.get(name.lower(), "")
    if known.startswith(f"{package}/"):
        return known
    is_name = re.fullmatch(r"\w+", name) and is_message_name(meant)
    return f"{package}/{meant}" if slash and is_name and is_package_name(package) else ""


def _container(text: str) -> str:
    """A hint for a container type of another language, or ""."""
    found = _CONTAINER.fullmatch(text)
    if not found:
        return ""
    element = _EQUIVALENTS.get(found[1].lower(), found[1])
    if not (element in PRIMITIVES or "/" in element or is_message_name(element)):
        return ""
    return f"did you mean {element}[{found[2] or ''}]?"


def size_hint(text: str) -> str:
    """A hint for the size of the array type `text`, or ""."""
    if container := _container(text):
        return container
    found = re.fullmatch(r"([\w/]+)\[([<>=]*)(-?\w*)\]", text)
    if not found:
        return ""
    base, sign, size = found.groups()
    if not size.isdecimal() or not size.strip("0"):
        return f"the size is a number above 0; without a size the array has any length: {base}[]"
    return f"an array of at most {size} is written {base}[<={size}]" if "<" in sign else ""


def _bracket_hint(base: str, text: str) -> str:
    if found := re.fullmatch(r"(w?string)<=?(\d+)>?", base):
        return f"did you mean {found[1]}<={found[2]}?"
    if "<=" in base:
        name, _, size = base.partition("<=")
        array = f": {name}[<={size}]" if size.isdecimal() else ""
        return f"only strings have such a bound; write the bound of an array in brackets{array}"
    if "[" in text and not text.endswith("]"):
        return "write the brackets of an array without spaces, for example int32[<=5]"
    return ""


def _similar_hint(base: str, tail: str) -> str:
    """A hint: a built-in type with one typo, else a well-known message, else the valid types."""
    word = base.rstrip(":;,?*&")
    near = (
        [word]
        if word in PRIMITIVES
        else sorted(name for name in PRIMITIVES if is_one_typo(word.lower(), name))
    )
    if near:
        return suggest([f"{name}{tail}" for name in near])
    if common := _COMMON_MESSAGES.get(base.lower()):
        return f"did you mean {common}{tail}?"
    if base.lower() in _ARRAY_WORDS:
        return "write an array as the type of its elements with brackets, such as int32[]"
    if base in _MAPPINGS:
        return "define a message (.msg) with these fields and write its name here"
    for shape, choice in _BUILT_IN_SHAPES.items():
        if shape.fullmatch(base):
            return f"there are {choice}"
    return ""
