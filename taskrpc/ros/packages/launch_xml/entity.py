"""Reads XML into the elements of a launch file, each with its line."""

from __future__ import annotations

from typing import Any
from xml.parsers import expat

from launch.frontend.entity import Entity as _Entity
from launch.launch_description_source import InvalidLaunchFileError


class Entity(_Entity):
    """An element of an XML launch file."""


def read_xml(text: str | bytes, location: str) -> Entity:
    """Return the outermost element of an XML text; raises InvalidLaunchFileError with the line."""
    parser = expat.ParserCreate()
    opened: list[tuple[str, dict[str, str], list[Any], str]] = []
    found: list[Entity] = []

    def begin(name: str, attributes: dict[str, str]) -> None:
        opened.append((name, attributes, [], f"{location}, line {parser.CurrentLineNumber}"))

    def end(_: str) -> None:
        entity = Entity(*opened.pop())
        (opened[-1][2] if opened else found).append(entity)

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise InvalidLaunchFileError(
            f"{location}, line {error.lineno}: invalid XML: {expat.ErrorString(error.code)}"
        ) from None
    return found[0]
