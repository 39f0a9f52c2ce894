"""Which callbacks of a node may run at the same time."""

from __future__ import annotations

import threading
import weakref

from ._impl.execution.entity import Entity


class CallbackGroup:
    """What entities share that restrict each other; a subclass says how."""

    def __init__(self) -> None:
        self.entities: set[weakref.ReferenceType[Entity]] = set()

    def add_entity(self, entity: Entity) -> None:
        """Let the group decide when this entity's callbacks run."""
        self.entities.add(weakref.ref(entity))

    def has_entity(self, entity: Entity) -> bool:
        """Whether the entity is in this group."""
        return weakref.ref(entity) in self.entities

    def can_execute(self, entity: Entity) -> bool:
        """Whether a callback of the entity could begin now."""
        raise NotImplementedError

    def beginning_execution(self, entity: Entity) -> bool:
        """Ask to begin a callback; when this says True, `ending_execution` must follow."""
        raise NotImplementedError

    def ending_execution(self, entity: Entity) -> None:
        """Tell that the callback has ended."""
        raise NotImplementedError


class ReentrantCallbackGroup(CallbackGroup):
    """Its callbacks may all run at once, also one beside itself."""

    def can_execute(self, entity: Entity) -> bool:
        """Always."""
        return True

    def beginning_execution(self, entity: Entity) -> bool:
        """Always."""
        return True

    def ending_execution(self, entity: Entity) -> None:
        """Nothing to do: nobody waits for it."""


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """Only one of its callbacks runs at a time; an async one holds it while it waits, too."""

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
        """True for one entity, until that one's callback has ended."""
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
