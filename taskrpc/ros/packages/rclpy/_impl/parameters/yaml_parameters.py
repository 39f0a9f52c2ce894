"""Reads values of parameters from YAML by the rules of ROS, which are not those of YAML 1.1.

In ROS, `1e3` is a float, `010` is octal, `12:30` is a string, and every array has one type.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import TypeAlias

import yaml

from taskrpc.spi import yaml_text

Value: TypeAlias = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]
"""The value of a parameter in a file or on a command line."""

Parameters: TypeAlias = dict[str, dict[str, Value]]
"""The values by node name, which may contain wildcards, and by parameter name."""

ROS_PARAMETERS = "ros__parameters"
"""The key above the parameters of a node."""

ANY_NODE = "/**"
"""The name that stands for every node."""

_BOOLS = {
    **dict.fromkeys("Y y yes Yes YES true True TRUE on On ON".split(), True),
    **dict.fromkeys("N n no No NO false False FALSE off Off OFF".split(), False),
}
_INTEGER = re.compile(r"([+-]?)(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NAMED_FLOATS = {
    **dict.fromkeys(".nan .NaN .NAN nan NaN NAN".split(), math.nan),
    **dict.fromkeys(".inf .Inf .INF +.inf +.Inf +.INF inf Inf INF".split(), math.inf),
    **dict.fromkeys("-.inf -.Inf -.INF -inf -Inf -INF".split(), -math.inf),
}
_STRING_STYLES = ("'", '"', "|", ">")
_LONGEST_INTEGER = 100
"""Characters. Python refuses to convert thousands of digits."""
_WRITTEN_TAG = re.compile(r"(?:&\S+\s+)?!")
_INT64 = range(-(2**63), 2**63)
_TYPE_NAMES = {bool: "bool", int: "integer", float: "double", str: "string"}


def read_value(text: str) -> Value:
    """The value after `:=` on a command line. Raises ValueError with the text of ROS."""
    node = _compose(text)
    if node is None:
        raise ValueError("No value at line 1")
    return _value(node)


def read_file(text: str) -> Parameters:
    """The parameters of a `--params-file`. Raises ValueError with the text of ROS."""
    found: Parameters = {}
    if (node := _compose(text)) is not None:
        _nodes(node, "", found)
    return found


def _compose(text: str) -> yaml.Node | None:
    try:
        return yaml_text.compose(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = 1 if mark is None else mark.line + 1
        problem = yaml_text.message(error)
        raise ValueError(f"Error parsing a event near line {line}: {problem}") from None


def _nodes(node: yaml.Node, prefix: str, found: Parameters) -> None:
    """Add the parameters of every node below a mapping of namespaces and nodes to `found`."""
    if not isinstance(node, yaml.MappingNode):
        line = node.start_mark.line + 1
        raise ValueError(f"Cannot have a value before {ROS_PARAMETERS} at line {line}")
    for key, value in node.value:
        if _key(key) == ROS_PARAMETERS:
            if not prefix:
                raise ValueError(f"No node names before {ROS_PARAMETERS} at line {_line(key)}")
            _parameters(value, "", found.setdefault(prefix, {}))
        else:
            _nodes(value, _joined(prefix, _key(key)), found)


def _joined(prefix: str, name: str) -> str:
    return f"{prefix.rstrip('/')}/{name.lstrip('/')}" if prefix else name


def _parameters(node: yaml.Node, prefix: str, found: dict[str, Value]) -> None:
    """Add the parameters of one node to `found`; a dot joins a group and its member."""
    if not isinstance(node, yaml.MappingNode):
        raise ValueError(f"Expected a map of parameters at line {_line(node)}")
    for key, value in node.value:
        name = f"{prefix}{_key(key)}"
        if isinstance(value, yaml.MappingNode):
            _parameters(value, f"{name}.", found)
        else:
            found[name] = _value(value)


def _key(node: yaml.Node) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise ValueError(
            f"Sequences can only be values and not keys in params. Error at line {_line(node)}"
        )
    return str(node.value)


def _value(node: yaml.Node) -> Value:
    if isinstance(node, yaml.SequenceNode):
        return _array(node)
    if isinstance(node, yaml.ScalarNode):
        return _scalar(node)
    raise ValueError(f"Expected a value, not a map, at line {_line(node)}")


def _array(node: yaml.SequenceNode) -> Value:
    items: list[bool | int | float | str] = []
    for one in node.value:
        if not isinstance(one, yaml.ScalarNode):
            raise ValueError(f"Sequence cannot contain sequences or maps, at line {_line(one)}")
        item = _scalar(one)
        if items and type(item) is not type(items[0]):
            raise ValueError(
                f"Sequence should be of same type. Value type '{_TYPE_NAMES[type(item)]}'"
                f" do not belong at line_num {_line(one)}"
            )
        items.append(item)
    return items  # type: ignore[return-value]  # checked above: all of one type


def _scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    text = str(node.value)
    is_tagged = _has_tag(node)
    if is_tagged and node.tag in _TAGGED:
        return _tagged(node, text)
    if node.style in _STRING_STYLES or is_tagged:
        return text
    if not text:
        raise ValueError(f"No value at line {_line(node)}")
    if text in _BOOLS:
        return _BOOLS[text]
    if (number := _integer(text)) is not None:
        return number
    double = _double(text)
    return text if double is None else double


def _has_tag(node: yaml.Node) -> bool:
    """Whether a scalar has an explicit tag; otherwise PyYAML chose one by its own rules."""
    mark = node.start_mark
    return mark.buffer is not None and _WRITTEN_TAG.match(mark.buffer, mark.pointer) is not None


def _tagged(node: yaml.ScalarNode, text: str) -> bool | int | float:
    """A scalar with the tag `!!bool`, `!!int` or `!!float`, quoted or not."""
    name, read = _TAGGED[node.tag]
    value = read(text)
    if value is None:
        raise ValueError(f"Invalid value {text[:40]!r} for {name} at line {_line(node)}")
    return value


def _integer(text: str) -> int | None:
    """A 64-bit integer; None for anything else."""
    match = _INTEGER.fullmatch(text)
    if match is None or len(text) > _LONGEST_INTEGER:
        return None
    sign, digits = match.groups()
    base = 16 if digits[:2] in ("0x", "0X") else 8 if digits[0] == "0" else 10
    number = int(digits, base) * (-1 if sign == "-" else 1)
    return number if number in _INT64 else None


def _double(text: str) -> float | None:
    """A floating-point number; None for anything else."""
    if text in _NAMED_FLOATS:
        return _NAMED_FLOATS[text]
    return float(text) if _FLOAT.fullmatch(text) else None


_TAGGED: dict[str, tuple[str, Callable[[str], bool | int | float | None]]] = {
    "tag:yaml.org,2002:bool": ("!!bool", _BOOLS.get),
    "tag:yaml.org,2002:int": ("!!int", _integer),
    "tag:yaml.org,2002:float": ("!!float", _double),
}


def _line(node: yaml.Node) -> int:
    return node.start_mark.line + 1
