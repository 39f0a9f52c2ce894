"""Reads YAML into the elements of a launch file."""

from __future__ import annotations

from typing import Any

import yaml
from launch.frontend.entity import Entity as _Entity
from launch.launch_description_source import InvalidLaunchFileError

from taskrpc.spi import yaml_text

_CHILDREN = "children"


class Entity(_Entity):
    """An element of a YAML launch file."""


def read_yaml(text: str, location: str) -> Entity:
    """Return the outermost element of a YAML text; raises InvalidLaunchFileError."""
    try:
        found = yaml_text.load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f", line {mark.line + 1}"
        problem = f"{location}{line}: invalid YAML: {yaml_text.message(error)}"
        raise InvalidLaunchFileError(problem) from None
    if not isinstance(found, dict) or len(found) != 1:
        raise InvalidLaunchFileError(f"{location}: expected one key, launch, at the top")
    name, content = next(iter(found.items()))
    return _entity(str(name), content, location)


def _entity(name: str, content: Any, location: str) -> Entity:
    """An element: a list has the elements inside, a mapping also attributes."""
    if isinstance(content, list):
        return Entity(name, {}, [_child(name, each, location) for each in content], location)
    if content is None:
        content = {}
    if not isinstance(content, dict):
        raise InvalidLaunchFileError(f"{location}: expected a mapping or a list in `{name}`")
    attributes: dict[str, Any] = {}
    children: list[Entity] = []
    for key, value in content.items():
        if key == _CHILDREN:
            children += [_child(name, each, location) for each in value or ()]
        elif isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
            children += [_entity(str(key), each, location) for each in value]
        else:
            attributes[str(key)] = value
    return Entity(name, attributes, children, location)


def _child(name: str, content: Any, location: str) -> Entity:
    if isinstance(content, dict) and len(content) > 1 and next(iter(content.values())) is None:
        first = next(iter(content))
        raise InvalidLaunchFileError(
            f"{location}: expected the keys of `{first}` inside it, got them beside it; indent the"
            f" lines below `- {first}:` by two more spaces"
        )
    if not isinstance(content, dict) or len(content) != 1:
        raise InvalidLaunchFileError(
            f"{location}: expected elements with one key each in `{name}`, got {content!r}"
        )
    inner, value = next(iter(content.items()))
    return _entity(str(inner), value, location)
