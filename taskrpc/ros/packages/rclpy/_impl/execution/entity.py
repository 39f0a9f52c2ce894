"""Entities, the objects of a node that callbacks come from, and the callbacks that run now.

This module is the lowest of the execution machinery. It describes executors and callback groups
by protocols, so that it needs neither `rclpy.executors` nor `rclpy.callback_groups`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol


class GroupInterface(Protocol):
    """The part of a callback group that executors use; `rclpy.callback_groups` has the classes."""

    def can_execute(self, entity: Any) -> bool:
        """Whether a callback of the entity may begin now."""

    def beginning_execution(self, entity: Any) -> bool:
        """Reserve the group for a callback; after True, `ending_execution` must follow."""

    def ending_execution(self, entity: Any) -> None:
        """Release the group."""


class ExecutorInterface(Protocol):
    """The part of an executor that futures, entities and diagnostics use."""

    @property
    def runs_one_at_a_time(self) -> bool:
        """Whether a callback that waits prevents every other callback from running."""

    @property
    def thread_count(self) -> int:
        """How many callbacks may run at the same time."""

    @property
    def is_unattended(self) -> bool:
        """Whether callbacks may still run although no thread spins the executor any more."""

    def create_task(self, callback: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """Run a function or coroutine function on the spinning thread."""

    def resume_task(self, task: Any) -> None:
        """Call a task again in the next round; from any thread."""

    def notify(self) -> None:
        """Wake the spinning threads; from any thread and from signal handlers."""

    def wake(self) -> None:
        """Collect the entities of the nodes again: one was created or destroyed."""

    def remove_node(self, node: Any) -> None:
        """Stop running the callbacks of this node."""

    def has_node(self, node: Any) -> bool:
        """Whether it runs the callbacks of this node."""

    def get_nodes(self) -> Sequence[Any]:
        """The nodes whose callbacks it runs."""

    def entities_of(self, node: Any) -> Sequence[tuple[Entity, Any]]:
        """The entities of a node, each with the node."""


class Entity:
    """An object of a node that callbacks come from; executors query it for one item at a time."""

    is_timer: ClassVar[bool] = False
    """Whether it becomes ready at a point in time (`nanoseconds_until_due`)."""

    is_service: ClassVar[bool] = False
    """Whether a caller waits for the value that its callback returns."""

    is_scheduled = False
    """True after an executor chose it and until its item is taken: it must not be chosen again."""

    callback_group: GroupInterface | None = None
    """Decides when a callback of the entity may run; None means always."""

    parent_node: Any = None
    """The node that created it; None before a node has it."""

    def has_work(self) -> bool:
        """Whether an item waits to be taken. The spinning thread calls this often."""
        raise NotImplementedError

    def nanoseconds_until_due(self) -> int | None:
        """For a timer: the time until it is due; None when it will never be due."""
        raise NotImplementedError

    def take_work(self) -> Callable[[], Any] | None:
        """Take one item and return the function that handles it; None when it is already gone."""
        raise NotImplementedError

    def notify_executor(self) -> None:
        """Wake the executor of the node; from any thread."""
        node = self.parent_node
        if node is not None and (executor := node.executor) is not None:
            executor.notify()


class Callback(NamedTuple):
    """A callback that is running now."""

    entity: Entity | None
    """The entity that it belongs to; None for a task and for a done callback of a future."""
    executor: ExecutorInterface
    since: float
    """When it began, on the clock of `time.monotonic()`."""


running: dict[int, Callback] = {}
"""The innermost running callback of each thread, by thread identifier."""


def current_callback() -> Callback | None:
    """The callback that runs on this thread, if there is one."""
    return running.get(threading.get_ident())


def is_busy(executor: ExecutorInterface | None) -> bool:
    """Whether a callback of this executor runs on any thread."""
    return any(callback.executor is executor for callback in list(running.values()))


def started(entity: Entity | None, executor: ExecutorInterface) -> Callback | None:
    """Record that a callback begins on this thread. Pass the returned value to `ended`."""
    thread = threading.get_ident()
    before = running.get(thread)
    running[thread] = Callback(entity, executor, time.monotonic())
    return before


def ended(before: Callback | None) -> None:
    """Record that the callback has ended, or awaits something and releases the thread."""
    thread = threading.get_ident()
    if before is None:
        running.pop(thread, None)
    else:
        running[thread] = before


def callback_name(callback: Callback) -> str:
    """The name of a callback for messages: its function and its node."""
    entity = callback.entity
    if entity is None:
        return "a task or done callback"
    function = getattr(entity, "callback", None)
    function = getattr(function, "__qualname__", type(entity).__name__)
    service = getattr(entity, "service_name", "")
    offered = f" (service {service})" if service else ""
    return f"{function}(){offered} of {node_name(entity.parent_node)}"


def node_name(node: Any) -> str:
    """The fully qualified name of a node, for messages; also of a destroyed node."""
    handle = getattr(node, "handle", None)
    return getattr(handle, "full_name", f"/{type(node).__name__}")
