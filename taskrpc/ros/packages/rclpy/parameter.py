"""Parameters, which have a name, a type and a value, and their messages."""

from __future__ import annotations

import array
import enum
import types
from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

import srvgen

from ._impl.arguments import fits

ParameterMsg = srvgen.load("rcl_interfaces/msg/Parameter")
ParameterType = srvgen.load("rcl_interfaces/msg/ParameterType")
ParameterValue = srvgen.load("rcl_interfaces/msg/ParameterValue")

PARAMETER_SEPARATOR_STRING = "."
"""Separates the parts of a parameter name."""

AllowableParameterValue: TypeAlias = (
    bool
    | int
    | float
    | str
    | Sequence[bytes]
    | Sequence[bool]
    | Sequence[int]
    | Sequence[float]
    | Sequence[str]
    | None
)
"""The types of parameter values."""

_ROS_PARAMETERS = "ros__parameters"


class _ParameterKind(enum.IntEnum):
    """The types that a parameter can have; programs know it as `Parameter.Type`."""

    __str__ = enum.Enum.__str__

    def __format__(self, format_spec: str) -> str:
        """Return its name; the number of an IntEnum would explain nothing in an error."""
        return format(str(self), format_spec)

    NOT_SET = ParameterType.PARAMETER_NOT_SET
    BOOL = ParameterType.PARAMETER_BOOL
    INTEGER = ParameterType.PARAMETER_INTEGER
    DOUBLE = ParameterType.PARAMETER_DOUBLE
    STRING = ParameterType.PARAMETER_STRING
    BYTE_ARRAY = ParameterType.PARAMETER_BYTE_ARRAY
    BOOL_ARRAY = ParameterType.PARAMETER_BOOL_ARRAY
    INTEGER_ARRAY = ParameterType.PARAMETER_INTEGER_ARRAY
    DOUBLE_ARRAY = ParameterType.PARAMETER_DOUBLE_ARRAY
    STRING_ARRAY = ParameterType.PARAMETER_STRING_ARRAY

    @classmethod
    def from_parameter_value(cls, parameter_value: object) -> _ParameterKind:
        """The type of a value. Raises TypeError for a value that no parameter can have."""
        if parameter_value is None:
            return cls.NOT_SET
        for python_type, kind in _SCALARS.items():
            if isinstance(parameter_value, python_type):
                return kind
        if not isinstance(parameter_value, (list, tuple, array.array)):
            raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")
        for python_type, kind in _ARRAYS.items():
            if all(isinstance(one, python_type) for one in parameter_value):
                return kind
        raise TypeError(
            f"The given value is not a list of one of the allowed types '{parameter_value}'."
        )

    def check(self, parameter_value: object) -> bool:
        """Whether a value is of this type."""
        if self is _ParameterKind.NOT_SET:
            return parameter_value is None
        for python_type, kind in _SCALARS.items():
            if kind is self:
                return isinstance(parameter_value, python_type)
        if isinstance(parameter_value, array.array):
            if self not in (_ParameterKind.INTEGER_ARRAY, _ParameterKind.DOUBLE_ARRAY):
                return False
        elif not isinstance(parameter_value, (list, tuple)):
            return False
        return all(self._is_element(one) for one in parameter_value)

    def _is_element(self, one: object) -> bool:
        if isinstance(one, bytes):
            return self is _ParameterKind.BYTE_ARRAY and len(one) == 1
        return any(kind is self and isinstance(one, has) for has, kind in _ARRAYS.items())

    @property
    def _field(self) -> str:
        """The field of a ParameterValue that holds a value of this type."""
        return f"{self.name.lower()}_value"


_ParameterKind.__name__ = "Type"
_ParameterKind.__qualname__ = "Parameter.Type"

# The order matters: a bool is also an int, and an empty list has the type of the first entry.
_SCALARS = {
    bool: _ParameterKind.BOOL,
    int: _ParameterKind.INTEGER,
    float: _ParameterKind.DOUBLE,
    str: _ParameterKind.STRING,
}
_ARRAYS = {
    bytes: _ParameterKind.BYTE_ARRAY,
    bool: _ParameterKind.BOOL_ARRAY,
    int: _ParameterKind.INTEGER_ARRAY,
    float: _ParameterKind.DOUBLE_ARRAY,
    str: _ParameterKind.STRING_ARRAY,
}


class Parameter:
    """One parameter: `Parameter("speed", value=1.5)`; the type may come before the value.

    Raises TypeError for an invalid type and for a value that no parameter can have, ValueError if
    the value does not have the type.
    """

    Type: TypeAlias = _ParameterKind
    __class_getitem__: Any = classmethod(
        types.GenericAlias
    )  # for annotations such as Parameter[int]

    def __init__(
        self,
        name: str,
        type_: _ParameterKind | None = None,
        value: AllowableParameterValue = None,
    ) -> None:
        if type_ is None:
            type_ = _ParameterKind.from_parameter_value(value)
        if not isinstance(type_, _ParameterKind):
            raise TypeError(f"type must be an instance of '{_ParameterKind!r}'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self._type_ = type_
        self._name = name
        self._value = value

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        """Create a parameter from a `rcl_interfaces/msg/Parameter`."""
        kind = _ParameterKind(param_msg.value.type)
        value = None
        if kind is not _ParameterKind.NOT_SET:
            value = getattr(param_msg.value, kind._field)
        if isinstance(value, array.array):  # ROS's messages have a subclass of it
            value = array.array(value.typecode, value)
        return cls(param_msg.name, kind, value)

    @property
    def name(self) -> str:
        """The full name; dots separate its parts."""
        return self._name

    @property
    def type_(self) -> _ParameterKind:
        """The type of the value."""
        return self._type_

    @property
    def value(self) -> Any:
        """The value; None if it is not set."""
        return self._value

    def get_parameter_value(self) -> Any:
        """The value as a `rcl_interfaces/msg/ParameterValue`."""
        message = ParameterValue(type=self.type_.value)
        if self.type_ is not _ParameterKind.NOT_SET:
            setattr(message, self.type_._field, self.value)
        return message

    def to_parameter_msg(self) -> Any:
        """The parameter as a `rcl_interfaces/msg/Parameter`."""
        return ParameterMsg(name=self.name, value=self.get_parameter_value())


def get_parameter_value(string_value: str) -> Any:
    """The ParameterValue of a text that a user typed: YAML, or a string if it is not YAML."""
    import yaml  # few programs need it

    from taskrpc.spi import yaml_text

    try:
        value = yaml_text.load(string_value)
    except yaml.YAMLError:
        value = string_value
    try:
        kind = _ParameterKind.from_parameter_value(value)
    except TypeError:
        kind = _ParameterKind.STRING
    if value == []:
        kind = _ParameterKind.BOOL_ARRAY
    if kind in (_ParameterKind.NOT_SET, _ParameterKind.STRING, _ParameterKind.BYTE_ARRAY):
        kind, value = _ParameterKind.STRING, value if isinstance(value, str) else string_value
    message = ParameterValue(type=kind.value)
    setattr(message, kind._field, value)
    return message


def parameter_value_to_python(parameter_value: Any) -> Any:
    """The value of a ParameterValue; None if it is not set.

    Raises RuntimeError for an unknown type.
    """
    try:
        kind = _ParameterKind(parameter_value.type)
    except ValueError:
        raise RuntimeError(f"unexpected parameter type {parameter_value.type}") from None
    if kind is _ParameterKind.NOT_SET:
        return None
    value = getattr(parameter_value, kind._field)
    return list(value) if kind in _ARRAYS.values() else value


def parameter_dict_from_yaml_file(
    parameter_file: str,
    use_wildcard: bool = False,
    target_nodes: list[str] | None = None,
    namespace: str = "",
) -> dict[str, Any]:
    """The parameters of a file such as `ros2 param dump` writes: messages by parameter name.

    Args:
        parameter_file: the path of the file.
        use_wildcard: whether to include node names with `*`; the node's own name has precedence.
        target_nodes: the nodes whose parameters to return; all nodes by default.
        namespace: a prefix of every parameter name.

    Raises:
        RuntimeError: the file has no parameters for these nodes, or is not a parameter file.
    """
    from taskrpc.spi import read_text, yaml_text

    text = read_text(parameter_file)
    nodes = list(_nodes(yaml_text.load(text) or {}))
    found: dict[str, Any] = {}
    chosen = False
    for is_wild in (True, False) if use_wildcard else (False,):
        for name, parameters in nodes:
            if ("*" in name) is is_wild and _is_selected(name, target_nodes):
                chosen = True
                found.update(parameters)
    if not chosen:
        for_nodes = f" for {', '.join(target_nodes)}" if target_nodes else ""
        raise RuntimeError(
            f"Param file does not contain any valid parameters{for_nodes},"
            f" only for nodes: {[name for name, _ in nodes]}"
        )
    return dict(_flat(namespace, found))


def _is_selected(name: str, target_nodes: list[str] | None) -> bool:
    """Whether a name in the file selects one of the nodes; always True without target nodes.

    Here `/**/name` selects only nodes in a namespace; with `--params-file` it selects all nodes.
    """
    targets = [f"/{node.lstrip('/')}" for node in target_nodes or ()]
    if name.startswith("/**/"):
        targets = [node for node in targets if node.count("/") > 1]
    return not target_nodes or any(fits(name, node) for node in targets)


def _nodes(content: Any, prefix: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """The fully qualified names of the nodes in a file, and their parameters."""
    if not isinstance(content, dict):
        raise RuntimeError("YAML file is not a valid ROS parameter file: expected a mapping")
    for key, below in content.items():
        name = f"{prefix.rstrip('/')}/{str(key).lstrip('/')}" if prefix else str(key)
        parameters = below.get(_ROS_PARAMETERS, {}) if isinstance(below, dict) else None
        if not below or not isinstance(parameters, dict | None) or not isinstance(below, dict):
            raise RuntimeError(f"YAML file is not a valid ROS parameter file for node {name}")
        if _ROS_PARAMETERS in below:
            yield name, parameters or {}
        else:
            yield from _nodes(below, name)


def _flat(prefix: str, parameters: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """The parameters, also those in groups, by full name."""
    for name, value in parameters.items():
        full = f"{prefix}{name}"
        if isinstance(value, dict):
            yield from _flat(full + PARAMETER_SEPARATOR_STRING, value)
        else:
            yield full, ParameterMsg(name=full, value=get_parameter_value(str(value)))
