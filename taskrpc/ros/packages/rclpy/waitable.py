"""Waitables: entities that a program defines itself and adds to a node."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar

from ._impl.execution.entity import Entity
from .callback_groups import CallbackGroup
from .guard_condition import GuardCondition
from .handle import Handle
from .task import Future, set_executor

T = TypeVar("T")


@dataclasses.dataclass
class NumberOfEntities:
    """How many entities of each kind a waitable waits for; objects can be added."""

    num_subscriptions: int
    num_guard_conditions: int
    num_timers: int
    num_clients: int
    num_services: int
    num_events: int

    def __init__(
        self,
        num_subs: int = 0,
        num_gcs: int = 0,
        num_timers: int = 0,
        num_clients: int = 0,
        num_services: int = 0,
        num_events: int = 0,
    ) -> None:
        self.num_subscriptions = num_subs
        self.num_guard_conditions = num_gcs
        self.num_timers = num_timers
        self.num_clients = num_clients
        self.num_services = num_services
        self.num_events = num_events

    def __add__(self, other: NumberOfEntities) -> NumberOfEntities:
        ours, theirs = dataclasses.astuple(self), dataclasses.astuple(other)
        return NumberOfEntities(*(a + b for a, b in zip(ours, theirs, strict=True)))

    def __iadd__(self, other: NumberOfEntities) -> Self:
        for field in dataclasses.fields(self):
            added = getattr(self, field.name) + getattr(other, field.name)
            setattr(self, field.name, added)
        return self


class WaitSet:
    """Collects the guard conditions of a waitable and tells which were triggered."""

    def __init__(self, node: Any) -> None:
        self.parent_node = node
        self._guards: list[GuardCondition] = []

    def add_guard_condition(self, handle: Handle) -> int:
        """Wait for the trigger of a guard condition; returns its index for `is_ready`."""
        guard: GuardCondition = handle.owner
        guard.parent_node = self.parent_node  # so that the trigger wakes the executor of this node
        self._guards.append(guard)
        return len(self._guards) - 1

    def is_ready(self, kind: str, index: int) -> bool:
        """Whether it was triggered since the last call; `kind` is "guard_condition"."""
        guard = self._guards[index]
        ready = guard.has_work()
        guard.take_work()
        return ready


class Waitable(Entity, Generic[T]):
    """An entity of the program's own, which an executor queries for work in each round.

    A subclass defines `is_ready`, `take_data` and `execute`, and adds its guard conditions in
    `add_to_wait_set`.
    """

    def __init__(self, callback_group: CallbackGroup) -> None:
        self.callback_group = callback_group
        self.callback_group.add_entity(self)
        self._futures: list[Future[Any]] = []

    def __enter__(self) -> None:
        """Do nothing: an executor starts to use it."""

    def __exit__(self, *exc_info: object) -> None:
        """Do nothing: an executor stops using it."""

    def add_future(self, future: Future[Any]) -> None:
        """Let the executor run the done callbacks of a future."""
        self._futures.append(future)

    def remove_future(self, future: Future[Any]) -> None:
        """Stop doing so for a future."""
        self._futures.remove(future)

    def is_ready(self, wait_set: Any) -> bool:
        """Whether there is data to take."""
        raise NotImplementedError("Must be implemented by subclass")

    def take_data(self) -> T:
        """Take the data, so that `is_ready` becomes False."""
        raise NotImplementedError("Must be implemented by subclass")

    async def execute(self, taken_data: T) -> None:
        """Handle the data that `take_data` took."""
        raise NotImplementedError("Must be implemented by subclass")

    def get_num_entities(self) -> NumberOfEntities:
        """How many entities it waits for; this layer does not call it."""
        return NumberOfEntities()

    def add_to_wait_set(self, wait_set: Any) -> None:
        """Add its guard conditions by their handles; keep their indices for `is_ready`."""

    def node_destroyed(self) -> None:
        """Do nothing: the node was destroyed, and the program may still use the waitable."""

    def has_work(self) -> bool:
        """Ask the subclass, by a wait set, whether there is work."""
        wait_set = WaitSet(self.parent_node)
        self.add_to_wait_set(wait_set)
        return self.is_ready(wait_set)

    def take_work(self) -> Callable[[], Any] | None:
        """Take the data of the subclass and return the call of `execute`."""
        for future in self._futures:
            set_executor(future, self.parent_node.executor)
        data = self.take_data()
        return lambda: self.execute(data)
