"""Turns the elements of XML and YAML launch files into actions."""

from __future__ import annotations

import importlib
from typing import Any

from ..launch_description import LaunchDescription
from ..substitution import Substitution
from . import elements as known_elements
from .entity import Entity
from .expose import action_parsers
from .hints import element_hint
from .parse_substitution import parse_if_substitutions, parse_substitution

_EXTENSIONS = ("launch_ros.elements",)


class ElementError(RuntimeError):
    """An element of a launch file cannot be read; the text says where it is."""


class Parser:
    """Turns elements into actions; the base class of the parsers for XML and YAML."""

    def __init__(self) -> None:
        known_elements.register()
        for name in _EXTENSIONS:
            importlib.import_module(name).register()

    def parse_action(self, entity: Entity) -> Any:
        """Return the action of an element; raises ElementError if it is unknown or wrong."""
        name = entity.type_name
        build = action_parsers.get(name) or action_parsers.get(name.replace("-", "_"))
        try:
            if build is None:
                hint = element_hint(name, action_parsers)
                raise RuntimeError(f"Unrecognized entity of the type: {name}{hint}")
            action = build(entity, self)
            entity.assert_entity_completely_parsed()
        except ElementError:
            raise
        except (AttributeError, RuntimeError, TypeError, ValueError) as error:
            location = f"{entity.location}: " if entity.location else ""
            raise ElementError(f"{location}{error}") from None
        return action

    def parse_substitution(self, value: Any) -> list[Substitution]:
        """Return the substitutions of a text."""
        return parse_substitution(value if isinstance(value, str) else str(value))

    def parse_if_substitutions(self, value: Any) -> Any:
        """Return the substitutions of a text; other values as they are."""
        return parse_if_substitutions(value)

    def parse_description(self, entity: Entity) -> LaunchDescription:
        """Return the launch description of a file's outermost element."""
        if entity.type_name != "launch":
            raise ElementError(
                f"{entity.location}: Expected 'launch' as root tag, got '{entity.type_name}'"
            )
        return LaunchDescription([self.parse_action(each) for each in entity.children])
