"""Converts messages to dicts and back."""

from __future__ import annotations

from collections.abc import Mapping
from time import time_ns
from typing import Any

from rosidl_runtime_py.utilities import get_message, get_service

import srvgen

_FIELDS = "get_fields_and_field_types"
_IN_SERVICES = {"request": "Request", "response": "Response"}


def convert_dictionary_to_ros_message(
    message_type: Any,
    dictionary: Mapping[str, Any],
    kind: str = "message",
    strict_mode: bool = True,
    check_missing_fields: bool = False,
    check_types: bool = True,
) -> Any:
    """A message with the values of a dict.

    Args:
        message_type: the class, or its name: `std_msgs/msg/String`, `std_srvs/srv/SetBool`.
        dictionary: values by field; nested messages are dicts. A time may be "now".
        kind: `message`, or with the name of a service `request` or `response`.
        strict_mode: whether an unknown field is an error; otherwise it is ignored.
        check_missing_fields: whether a field without a value is an error.
        check_types: whether a value of another type than its field's is an error.

    Raises:
        ValueError: a field is unknown or missing, or a value is not of its field's type.
    """
    message = _filled(message_type, dictionary, kind, strict_mode, check_missing_fields)
    if check_types:
        srvgen.to_cdr(message)  # it checks all fields
    return message


def _filled(
    message_type: Any,
    dictionary: Any,
    kind: str,
    strict_mode: bool,
    check_missing_fields: bool,
) -> Any:
    message = _class(message_type, kind)()
    if not isinstance(dictionary, Mapping):
        given = type(dictionary).__name__
        raise TypeError(f"expected a dict with the fields of {message._TYPE}, got {given}")
    types = message.get_fields_and_field_types()
    if unknown := [name for name in dictionary if name not in types]:
        if strict_mode:
            raise ValueError(f'ROS message type "{message_type}" has no field named "{unknown[0]}"')
        dictionary = {name: value for name, value in dictionary.items() if name in types}
    if check_missing_fields and (missing := [name for name in types if name not in dictionary]):
        raise ValueError(f"Missing fields: {missing}")

    def converted(value: Any, default: Any, item_type: str) -> Any:
        if value == "now" and item_type == "builtin_interfaces/Time":
            seconds, nanoseconds = divmod(time_ns(), 10**9)
            return type(default)(sec=seconds, nanosec=nanoseconds)
        if isinstance(value, Mapping):
            cls = type(default) if hasattr(default, _FIELDS) else _named(item_type)
            return _filled(cls, value, "message", strict_mode, check_missing_fields)
        return value

    for name, value in dictionary.items():
        default = getattr(message, name)
        if isinstance(value, list | tuple):
            item_type = types[name].removeprefix("sequence<").rstrip(">").partition("[")[0]
            item_type = item_type.partition(",")[0]
            setattr(message, name, [converted(one, None, item_type) for one in value])
        else:
            setattr(message, name, converted(value, default, types[name]))
    return message


def convert_ros_message_to_dictionary(message: Any) -> dict[str, Any]:
    """A dict with the fields of a message; nested messages become dicts, arrays lists."""
    names = message.get_fields_and_field_types()
    return {name: _plain(getattr(message, name)) for name in names}


def _plain(value: Any) -> Any:
    if hasattr(value, _FIELDS):
        return convert_ros_message_to_dictionary(value)
    if isinstance(value, str | bytes) or not hasattr(value, "__len__"):
        return value
    values = value.tolist() if hasattr(value, "tolist") else value
    return [_plain(one) for one in values]


def _class(message_type: Any, kind: str) -> Any:
    if not isinstance(message_type, str):
        return message_type
    if kind == "message":
        return get_message(message_type)
    if kind not in _IN_SERVICES:
        raise ValueError(f'Unknown kind "{kind}".')
    return getattr(get_service(message_type), _IN_SERVICES[kind])


def _named(name: str) -> Any:
    """The class of a type in a field: `geometry_msgs/Point`."""
    package, _, inner = name.partition("/")
    return get_message(f"{package}/msg/{inner}")
