"""The base class of everything that a launch description contains."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, TypeAlias

from .launch_context import LaunchContext


class LaunchDescriptionEntity:
    """An action or a whole launch description."""

    declares_argument = False
    """Whether the entity declares a launch argument."""

    def visit(self, context: LaunchContext) -> list[LaunchDescriptionEntity] | None:
        """Execute the entity; returns the entities to visit next."""
        return None

    def describe(self) -> str:
        """Describe the entity."""
        return repr(self)

    def get_sub_entities(self) -> list[Any]:
        """The entities that this one certainly contains."""
        return []

    def describe_sub_entities(self) -> list[LaunchDescriptionEntity]:
        """The entities that are executed if this one is."""
        return list(self.get_sub_entities())

    def describe_conditional_sub_entities(self) -> list[tuple[str, list[LaunchDescriptionEntity]]]:
        """The entities that may be executed later, each list with its reason."""
        return []

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """A future that is done when the entity's work is, None if it has no work left."""
        return None


SomeEntitiesType: TypeAlias = "LaunchDescriptionEntity | Iterable[LaunchDescriptionEntity]"
SomeActionsType: TypeAlias = SomeEntitiesType


def checked_entities(values: Any, where: str) -> list[Any]:
    """Turn an iterable into a list; raises TypeError if it contains something else than entities.

    Args:
        where: the beginning of the error, such as `GroupAction()`.
    """
    if isinstance(values, (str, LaunchDescriptionEntity)) or not isinstance(values, Iterable):
        raise TypeError(f"{where} expected a list of actions, got {values!r}")
    found = list(values)
    for each in found:
        if not isinstance(each, LaunchDescriptionEntity):
            raise TypeError(f"{where} expected actions, got {each!r}")
    return found


def entities_of(value: Any) -> list[LaunchDescriptionEntity]:
    """Turn None, one entity or several into a list; raises RuntimeError for anything else."""
    if value is None:
        return []
    found = [value] if isinstance(value, LaunchDescriptionEntity) else value
    if isinstance(found, str) or not isinstance(found, Iterable):
        raise RuntimeError(f"expected a LaunchDescriptionEntity, got '{value}'")
    entities = [each for each in found if each is not None]
    for each in entities:
        if not isinstance(each, LaunchDescriptionEntity):
            raise RuntimeError(f"expected a LaunchDescriptionEntity, got '{each}'")
    return entities


def visit_all_entities_and_collect_futures(
    entity: LaunchDescriptionEntity, context: LaunchContext
) -> list[tuple[LaunchDescriptionEntity, asyncio.Future[None]]]:
    """Visit an entity and all that it contains, in order; returns the unfinished ones."""
    found = []
    inner = entity.visit(context)
    future = entity.get_asyncio_future()
    if future is not None:
        found.append((entity, future))
    for each in inner or ():
        found += visit_all_entities_and_collect_futures(each, context)
    return found
