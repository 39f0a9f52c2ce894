"""Sets a message's fields from a dict, for example from YAML."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from functools import partial
from typing import Any

_HEADER = "std_msgs/msg/Header"
_TIME = "builtin_interfaces/msg/Time"


def set_message_fields(
    msg: Any,
    values: dict[str, Any],
    expand_header_auto: bool = False,
    expand_time_now: bool = False,
) -> list[Callable[[Any], None]]:
    """Set the named fields of a message; values of nested messages are dicts or messages.

    Args:
        msg: the message to change.
        values: the values by field name.
        expand_header_auto: whether "auto" is allowed as the value of a header.
        expand_time_now: whether "now" is allowed as the value of a time.

    Returns:
        One function for each "auto" and "now"; call it with the time to store.

    Raises:
        AttributeError: there is no such field.
        TypeError: the field is a message and the value is not a dict.
        ValueError: the value is not of the field's type.
    """
    return _Setting(expand_header_auto, expand_time_now).set(msg, values)


class _Setting:
    """The options of one call, and the functions that store a time later."""

    def __init__(self, header_auto: bool, time_now: bool) -> None:
        self._header_auto = header_auto
        self._time_now = time_now
        self._stamps: list[Callable[[Any], None]] = []

    def set(self, message: Any, values: Any) -> list[Callable[[Any], None]]:
        if not isinstance(values, dict):
            raise TypeError(
                f"Value '{values}' is expected to be a dictionary but is a {type(values).__name__}"
            )
        for name, value in values.items():
            self._set_field(message, name, value)
        return self._stamps

    def _set_field(self, message: Any, name: str, value: Any) -> None:
        present = getattr(message, name)
        kind = getattr(present, "_TYPE", "")
        if kind == _HEADER and value == "auto" and self._header_auto:
            self._stamps.append(partial(setattr, present, "stamp"))
        elif kind == _TIME and value == "now" and self._time_now:
            self._stamps.append(partial(setattr, message, name))
        else:
            nested = getattr(message, "_NESTED", {}).get(name)
            setattr(message, name, self._converted(present, value, nested))

    def _converted(self, present: Any, value: Any, nested: Any) -> Any:
        if isinstance(present, list):
            items = list(value)
            return items if nested is None else [self._message(nested, one) for one in items]
        if hasattr(present, "_TYPE"):
            return self._message(type(present), value)
        if hasattr(present, "dtype"):  # a numpy array: its class would take the list as a shape
            import numpy

            return numpy.array(value, dtype=present.dtype)
        if isinstance(present, array) or type(value) is type(present):
            return value
        return type(present)(value)

    def _message(self, cls: Any, value: Any) -> Any:
        if isinstance(value, cls):
            return value
        made = cls()
        self.set(made, value)
        return made
