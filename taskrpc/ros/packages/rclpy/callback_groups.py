"""Which callbacks of a node may run at the same time."""

from __future__ import annotations

import threading
import weakref

from ._impl.execution.entity import Entity


class CallbackGroup:
    """A set of entities whose callbacks restrict each other; a subclass defines the rule."""

    def __init__(self) -> None:
        self.entities: set[weakref.ReferenceType[Entity]] = set()

    def add_entity(self, entity: Entity) -> None:
        """Let the group decide when the callbacks of this entity run."""
        self.entities.add(weakref.ref(entity))

    def has_entity(self, entity: Entity) -> bool:
        """Whether the entity is in this group."""
        return weakref.ref(entity) in self.entities

    def can_execute(self, entity: Entity) -> bool:
        """Whether a callback of the entity may begin now."""
        raise NotImplementedError

    def beginning_execution(self, entity: Entity) -> bool:
        """Reserve the group for a callback; after True, `ending_execution` must follow."""
        raise NotImplementedError

    def ending_execution(self, entity: Entity) -> None:
        """Release the group: the callback has ended."""
        raise NotImplementedError


class ReentrantCallbackGroup(CallbackGroup):
    """Its callbacks may all run at the same time, even several runs of one callback."""

    def can_execute(self, entity: Entity) -> bool:
        """Always."""
        return True

    def beginning_execution(self, entity: Entity) -> bool:
        """Always."""
        return True

    def ending_execution(self, entity: Entity) -> None:
        """Do nothing: no callback waits for another."""


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """Only one of its callbacks runs at a time; a coroutine keeps the group while it awaits."""

    def __init__(self) -> None:
        super().__init__()
        self._active_entity: Entity | None = None
        self._lock = threading.Lock()

    @property
    def active_entity(self) -> Entity | None:
        """The entity whose callback holds the group; None while the group is free."""
        return self._active_entity

    def can_execute(self, entity: Entity) -> bool:
        """Whether no callback of the group runs."""
        return self._active_entity is None

    def beginning_execution(self, entity: Entity) -> bool:
        """Reserve the group; False while the callback of another entity holds it."""
        with self._lock:
            if self._active_entity is None:
                self._active_entity = entity
                return True
            return False

    def ending_execution(self, entity: Entity) -> None:
        """Let the next callback begin."""
        with self._lock:
            if self._active_entity is entity:
                self._active_entity = None
