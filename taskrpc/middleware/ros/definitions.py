"""Our classes for the types that ROS has built, made from ROS's generated classes. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import srvgen
from srvgen.definitions.lines import join_full_text
from taskrpc.spi import KEPT_CLASSES

_NAMES = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
"""The types that IDL and .msg files name differently."""
_SEQUENCE = re.compile(r"sequence<(.+?)(?:, (\d+))?>\Z")
_BOUNDED = re.compile(r"(w?string)<(\d+)>\Z")

FindMessage = Callable[[str], Any]
"""Returns ROS's class of a message such as `std_msgs/msg/Header`."""


@lru_cache(KEPT_CLASSES)
def message_of_ros(type_name: str, ros: Any, find: FindMessage) -> Any:
    """Return our class with the definition of a message class of ROS.

    Constants and defaults are missing: ROS does not count them as part of the definition.
    Raises srvgen.DefinitionError.
    """
    text = join_full_text(_lines(ros), _texts_of_nested([ros], find))
    return _documented(type_name, srvgen.define(type_name, text))


@lru_cache(KEPT_CLASSES)
def service_of_ros(type_name: str, ros: Any, find: FindMessage) -> Any:
    """Return our class with the definition of a service class of ROS. Raises DefinitionError."""
    request, response = ros.Request, ros.Response
    own = f"{_lines(request)}---\n{_lines(response)}"
    text = join_full_text(own, _texts_of_nested([request, response], find))
    return _documented(type_name, srvgen.define(type_name, text))


@lru_cache(KEPT_CLASSES)
def action_of_ros(type_name: str, ros: Any, find: FindMessage) -> Any:
    """Return our class with the definition of an action class of ROS. Raises DefinitionError."""
    sections = [ros.Goal, ros.Result, ros.Feedback]
    own = "---\n".join(_lines(section) for section in sections)
    text = join_full_text(own, _texts_of_nested(sections, find))
    return _documented(type_name, srvgen.define(type_name, text))


def _documented(type_name: str, made: Any) -> Any:
    """Return the class of the definition's file if it is equal: it has comments and defaults."""
    try:
        found = srvgen.load(type_name)
    except srvgen.DefinitionError:
        return made
    return found if found._HASH == made._HASH else made


def _lines(ros: type[Any]) -> str:
    """Return the fields of a generated class as lines of a .msg file."""
    fields = ros.get_fields_and_field_types().items()
    return "".join(f"{_type_of(idl)} {name}\n" for name, idl in fields)


def _type_of(idl: str) -> str:
    """Return a type as .msg files spell it: `sequence<double, 3>` is `float64[<=3]`."""
    if (found := _SEQUENCE.fullmatch(idl)) is not None:
        bound = f"<={found[2]}" if found[2] else ""
        return f"{_type_of(found[1])}[{bound}]"
    element, bracket, rest = idl.partition("[")
    if (found := _BOUNDED.fullmatch(element)) is not None:
        element = f"{found[1]}<={found[2]}"
    return _NAMES.get(element, element) + bracket + rest


def _texts_of_nested(outer: list[type[Any]], find: FindMessage) -> dict[str, str]:
    """Return the definitions of all messages inside these classes, by full name."""
    texts: dict[str, str] = {}
    waiting = list(outer)
    while waiting:
        for idl in waiting.pop().get_fields_and_field_types().values():
            name = _message_name(idl)
            if name and name not in texts:
                inner = find(name)
                texts[name] = _lines(inner)
                waiting.append(inner)
    return texts


def _message_name(idl: str) -> str:
    """Return the full name of the messages in a field, "" for other fields."""
    found = _SEQUENCE.fullmatch(idl)
    package, slash, message = (found[1] if found else idl).partition("[")[0].partition("/")
    return f"{package}/msg/{message}" if slash else ""
