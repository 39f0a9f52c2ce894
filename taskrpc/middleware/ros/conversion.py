"""Messages between our classes and those that ROS has generated. Pure.

Both classes must have the same definition; `definitions` compares them. Then the fields have the
same order and names, so a converter is a list of attributes and functions.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from typing import Any

from srvgen._runtime import ARRAY_CLASSES
from taskrpc.spi import KEPT_CLASSES

Convert = Callable[[Any], Any]

_CODES = {element: made._CODE for element, made in ARRAY_CLASSES.items()}
"""The type code of `array` for each numeric type."""


@lru_cache(KEPT_CLASSES)
def to_ros(ours: Any, ros: Any) -> Convert:
    """Return the function that turns a checked message of ours into a message of ROS."""
    fields = [
        (attribute, ros_name, _to_ros_value(type_, ours._NESTED.get(name), nested))
        for name, type_, attribute, ros_name, nested in _fields(ours, ros)
    ]
    plain = [(attribute, ros_name) for attribute, ros_name, convert in fields if convert is None]
    converted = [each for each in fields if each[2] is not None]

    def convert(message: Any) -> Any:
        made = ros()
        for attribute, ros_name in plain:
            setattr(made, ros_name, getattr(message, attribute))
        for attribute, ros_name, change in converted:
            setattr(made, ros_name, change(getattr(message, attribute)))  # type: ignore[misc]
        return made

    return convert


@lru_cache(KEPT_CLASSES)
def from_ros(ours: Any, ros: Any) -> Convert:
    """Return the function that turns a message of ROS into a message of ours.

    The result is not checked: a text that ROS allows may be longer than its bound.
    """
    fields = [
        (attribute, ros_name, _from_ros_value(type_, ours._NESTED.get(name), nested))
        for name, type_, attribute, ros_name, nested in _fields(ours, ros)
    ]

    def convert(message: Any) -> Any:
        values = {
            attribute: change(getattr(message, ros_name)) if change else getattr(message, ros_name)
            for attribute, ros_name, change in fields
        }
        return ours(**values)

    return convert


def _fields(ours: type[Any], ros: type[Any]) -> list[tuple[str, str, str, str, Any]]:
    """Return each field: name, type, our attribute, ROS's attribute, ROS's class of messages."""
    attributes = ours.__struct_fields__  # a keyword has an underscore at its end
    default = ros()
    found = []
    for (name, type_), attribute in zip(ours._FIELDS, attributes, strict=True):
        ros_name = name if hasattr(default, name) else f"{name}_"
        nested = _ros_class(ros, name, ours._NESTED[name]) if name in ours._NESTED else None
        found.append((name, type_, attribute, ros_name, nested))
    return found


def _ros_class(ros: Any, name: str, inner: Any) -> Any:
    """Return the class that ROS has generated for the messages in a field."""
    value = getattr(ros(), name)
    if not isinstance(value, list):
        return type(value)
    if value:
        return type(value[0])
    return message_class(inner._TYPE)  # a sequence is empty at first


def message_class(type_name: str) -> Any:
    """Return the class that ROS has generated for a message; `ros_class` is the checked way."""
    package, _, message = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), message)


def _to_ros_value(type_: str, ours: Any, ros: Any) -> Convert | None:
    """Return the function for the values of a field; None for values that both sides share."""
    element, bracket, size = type_.partition("[")
    if ours is not None and ros is not None:
        convert = to_ros(ours, ros)
        return (lambda values: [convert(each) for each in values]) if bracket else convert
    if not bracket:
        return None
    code = _CODES.get(element)
    if code is None:
        return list
    if size[:-1].isdecimal():
        return None  # ROS makes a numpy array out of the buffer
    return lambda values: array(code, values)


def _from_ros_value(type_: str, ours: Any, ros: Any) -> Convert | None:
    element, bracket, _ = type_.partition("[")
    if ours is not None and ros is not None:
        convert = from_ros(ours, ros)
        return (lambda values: [convert(each) for each in values]) if bracket else convert
    if bracket and element not in _CODES:
        return list
    return None  # our classes turn arrays and numpy's arrays into their own
