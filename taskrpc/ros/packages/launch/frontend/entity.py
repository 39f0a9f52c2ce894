"""The elements of a launch file, the same for XML and YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..utilities.type_utils import coerce_to_type
from .hints import attribute_hint


class Entity:
    """An element: its name, its attributes and the elements inside.

    Args:
        type_name: the element's name.
        attributes: texts in XML; in YAML other values, too.
        children: the elements inside.
        location: where the element is, for messages.
    """

    def __init__(
        self,
        type_name: str,
        attributes: Mapping[str, Any],
        children: Sequence[Entity] = (),
        location: str = "",
    ) -> None:
        self._type_name = type_name
        self._attributes = dict(attributes)
        self._children = list(children)
        self._location = location
        self._used: set[str] = set()
        self._all_children_used = False

    @property
    def type_name(self) -> str:
        """The element's name."""
        return self._type_name

    @property
    def children(self) -> list[Entity]:
        """The elements inside."""
        self._all_children_used = True
        return self._children

    @property
    def location(self) -> str:
        """Where the element is: a file and a line, "" if that is unknown."""
        return self._location

    def get_attr(
        self, name: str, *, data_type: Any = str, optional: bool = False, can_be_str: bool = True
    ) -> Any:
        """Return an attribute, with `data_type=list[Entity]` the elements inside of this name.

        Raises AttributeError if it is missing and not optional, and ValueError if it has another
        type. With `can_be_str`, a text with `$(` has every type.
        """
        self._used.add(name)
        found: Any
        if _is_entities(data_type):
            found = [each for each in self._children if each.type_name == name] or None
        else:
            found = self._attributes.get(name)
        if found is None:
            if optional:
                return None
            given = {*self._attributes, *(each.type_name for each in self._children)} - self._used
            hint = attribute_hint(self._type_name, sorted(given), [name])
            problem = f"Attribute '{name}' not found in Entity '{self._type_name}'"
            raise AttributeError(f"{problem}{hint}")
        if _is_entities(data_type) or data_type is None:
            return found
        if data_type is str:
            return str(found).lower() if isinstance(found, bool) else str(found)
        if not isinstance(found, str) or (can_be_str and "$(" in found):
            return found
        try:
            return coerce_to_type(found, data_type)
        except ValueError as error:
            raise ValueError(f"Attribute '{name}' of Entity '{self._type_name}': {error}") from None

    def assert_entity_completely_parsed(self) -> None:
        """Raise ValueError for an attribute or an element inside that nothing has read."""
        unknown = sorted(set(self._attributes) - self._used)
        if unknown:
            hint = attribute_hint(self._type_name, unknown, self._used)
            problem = f"Unexpected attribute(s) found in `{self._type_name}`: {unknown}"
            raise ValueError(f"{problem}{hint}")
        inner = sorted({each.type_name for each in self._children} - self._used)
        if inner and not self._all_children_used:
            hint = attribute_hint(self._type_name, inner, self._used)
            problem = f"Unexpected nested entity(ies) found in `{self._type_name}`: {inner}"
            raise ValueError(f"{problem}{hint}")


def _is_entities(data_type: Any) -> bool:
    """Return whether a type is a list of entities; programs write `List[Entity]`."""
    return getattr(data_type, "__args__", None) == (Entity,)
