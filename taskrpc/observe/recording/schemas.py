"""Schemas of recorded topics: the definition of a type as `ros2msg` text, and the class from it.

A `ros2msg` text is the definition of a message; each nested type follows under a line of 80 `=` and
a line `MSG: package/msg/Name`. For the events of a service, rosbag2 writes one of two forms: the
definition of the message `Name_Event`, or the text of the service under `SRV: package/srv/Name`.
This module writes the first form, which other readers understand, and reads both.
"""

from __future__ import annotations

from typing import Any

import srvgen
from srvgen.definitions.derived import event
from srvgen.definitions.lines import SEPARATOR, join_full_text, split_full_text
from srvgen.definitions.model import MessageDef, ServiceDef
from srvgen.definitions.names import split_type_name
from srvgen.files.dependencies import DefinitionSource, with_dependencies

EVENT = "_Event"
"""The end of the type name of a service's events."""
_SERVICE_HEADING = "=" * 80 + "\nSRV: "
_ACTION = "/action/"
"""The folder in the type names of an action's services and messages."""


def schema_text(type_name: str, source: DefinitionSource) -> str:
    """Return the `ros2msg` text of `package/msg/Name` or `package/srv/Name_Event`.

    Raises DefinitionError if a definition is missing or invalid.
    """
    service = _service_of(type_name)
    definition = source.load(service or type_name)
    ordered = with_dependencies(definition, source)
    texts = {
        each.full_name: _fields_text(each) if _is_part(each) else source.text(each.full_name)
        for each in ordered
        if isinstance(each, MessageDef)
    }
    if not isinstance(definition, ServiceDef):
        own = texts.pop(type_name)
        return join_full_text(own, texts)
    info = "service_msgs/msg/ServiceEventInfo"
    for each in with_dependencies(source.load(info), source):
        texts[each.full_name] = source.text(each.full_name)
    for section in (definition.request, definition.response):
        texts[f"{section.package}/{section.name}"] = _fields_text(section)
    return join_full_text(_fields_text(event(definition)), texts)


def class_from(type_name: str, text: str) -> Any:
    """Return the class of a recorded type; its `_HASH` equals that of an equal local type.

    The class of an action's part comes from the local definition of the action.

    Raises DefinitionError if the text is not a valid definition.
    """
    if _ACTION in type_name:
        return srvgen.load(type_name)
    service = _service_of(type_name)
    if text.startswith(_SERVICE_HEADING):  # rosbag2's form
        name, _, body = text.removeprefix(_SERVICE_HEADING).partition("\n")
        own, needed = split_full_text(body)
        defined = srvgen.define(name, join_full_text(own, _full_names(needed)))
        return defined.Event if service else defined
    own, needed = split_full_text(text)
    needed = _full_names(needed)
    if not service:
        return srvgen.define(type_name, join_full_text(own, needed))
    try:
        request, response = (
            needed.pop(_section_name(needed, service, section)) for section in _SECTIONS
        )
    except KeyError as missing:
        problem = f"expected the definition of {missing.args[0]} in the schema, got none"
        raise srvgen.DefinitionError(problem, path=type_name) from None
    body = f"{request.rstrip()}\n{SEPARATOR}\n{response}"
    return srvgen.define(service, join_full_text(body, needed)).Event


_SECTIONS = ("_Request", "_Response")


def is_event(type_name: str) -> bool:
    """Return whether a type is the event of a service."""
    return bool(_service_of(type_name))


def _service_of(type_name: str) -> str:
    """Return the service of an event type, "" for another type."""
    service = type_name.removesuffix(EVENT)
    has_calls = service.count("/srv/") == 1 or (
        _ACTION in service and service.endswith(("_SendGoal", "_GetResult"))
    )
    return service if has_calls and service != type_name else ""


def _is_part(message: MessageDef) -> bool:
    """Return whether a message is a part of an action, which has no file of its own."""
    return _ACTION in message.full_name


def _section_name(needed: dict[str, str], service: str, section: str) -> str:
    """Return the heading of a section; its folder is `srv` or, where left out, `msg`."""
    package, _, name = split_type_name(service)
    candidates = (f"{package}/srv/{name}{section}", f"{package}/msg/{name}{section}")
    return next((each for each in candidates if each in needed), candidates[0])


def _full_names(needed: dict[str, str]) -> dict[str, str]:
    """Return the nested texts under full names; some writers leave out the folder `msg`."""
    return {
        name.replace("/", "/msg/") if name.count("/") == 1 else name: text
        for name, text in needed.items()
    }


def _fields_text(message: MessageDef) -> str:
    """Return the fields of a message, with the packages of their types.

    Other readers search a type without a package in the folder of the service, where it is not.
    """
    return "".join(f"{field.type} {field.name}\n" for field in message.fields)
