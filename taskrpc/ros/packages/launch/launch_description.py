"""A list of entities, which a launch file returns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from .action import Action
from .launch_context import LaunchContext
from .launch_description_entity import LaunchDescriptionEntity, checked_entities


class LaunchDescription(LaunchDescriptionEntity):
    """What a launch file does, in order."""

    def __init__(
        self,
        initial_entities: Iterable[LaunchDescriptionEntity] | None = None,
        *,
        deprecated_reason: str | None = None,
    ) -> None:
        self._entities = checked_entities(initial_entities or (), "LaunchDescription()")
        self._deprecated_reason = deprecated_reason

    @property
    def entities(self) -> list[LaunchDescriptionEntity]:
        """The entities in order."""
        return self._entities

    @property
    def deprecated(self) -> bool:
        """Whether the launch file should no longer be used."""
        return self._deprecated_reason is not None

    @property
    def deprecated_reason(self) -> str | None:
        """Why the launch file should no longer be used."""
        return self._deprecated_reason

    def visit(self, context: LaunchContext) -> list[LaunchDescriptionEntity] | None:
        """Return the entities."""
        return list(self._entities)

    def get_sub_entities(self) -> list[Any]:
        """The entities in order."""
        return self._entities

    def add_entity(self, entity: LaunchDescriptionEntity) -> None:
        """Add an entity at the end."""
        self._entities += checked_entities([entity], "LaunchDescription")

    def add_action(self, action: Action) -> None:
        """Add an action at the end."""
        self.add_entity(action)

    def get_launch_arguments(self, conditional_inclusion: bool = False) -> list[Any]:
        """The actions that declare launch arguments, each name once, in order of appearance."""
        found: dict[str, Any] = {}
        for argument, is_conditional in _arguments(self._entities, conditional_inclusion):
            if argument.name not in found:
                argument.is_conditional = is_conditional
                found[argument.name] = argument
        return list(found.values())


def _arguments(
    entities: Iterable[LaunchDescriptionEntity], is_conditional: bool
) -> Iterator[tuple[Any, bool]]:
    for entity in entities:
        here = is_conditional or getattr(entity, "condition", None) is not None
        if entity.declares_argument:
            yield entity, here
        yield from _arguments(entity.describe_sub_entities(), here)
        for _, inner in entity.describe_conditional_sub_entities():
            yield from _arguments(inner, True)
