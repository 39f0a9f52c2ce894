"""What an executor does next: rounds of all that is ready, tasks and entities in turn.

A round is collected at once and worked off piece by piece, so that a busy timer or subscription
cannot keep a service from its turn.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeAlias

from ...context import Context
from ...task import Task
from ...utilities import get_default_context
from ..bridge import settle
from ..node_interface import NodeInterface
from .entity import Entity
from .wakeups import Sleep


class ExternalShutdownException(Exception):
    """The context was shut down by another thread or a signal while an executor was spinning."""


# Programs import it from `rclpy.executors`, and tracebacks show it under that name.
ExternalShutdownException.__module__ = __name__.partition("._impl")[0] + ".executors"


class TimeoutObject:
    """Seconds that are still left of a timeout; may be changed between two spins."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout


Timeout: TypeAlias = float | TimeoutObject | None
"""Seconds; None and negative ones never end."""

Work: TypeAlias = tuple[Task[Any] | None, Entity | None, Any]
"""One thing to run: a task, or else one thing that arrived at an entity; and the node."""

Layout: TypeAlias = list[tuple[Entity, Any]]
"""Entities, each with its node, in the order in which they are asked."""


def never() -> bool:
    """Do not stop for a condition."""
    return False


class Scheduler:
    """Knows the nodes and the tasks, waits, and says what is to be run next."""

    _youngest_first: ClassVar[bool] = True
    """The order of tasks that are ready at the same time: ROS's Jazzy takes the youngest first."""

    _respects_groups: ClassVar[bool] = True
    """Whether callback groups decide what may run; else a callback that awaits holds up nobody."""

    def __init__(self, *, context: Context | None = None) -> None:
        self._context = get_default_context() if context is None else context
        if self._context.handle is None:
            raise RuntimeError(
                "Context must be initialized before an executor can be created: rclpy.init() comes"
                " first"
            )
        self._nodes: dict[NodeInterface, None] = {}
        self._nodes_lock = threading.RLock()
        self._sleep = Sleep()
        self._version = object()
        self._layout: Layout | None = None
        self._round: deque[Work] = deque()
        self._tasks_were_last = False
        self._ready_tasks: deque[Task[Any]] = deque()
        self._parked: deque[Task[Any]] = deque()
        self._made = 0
        self._is_shutdown = False
        self._context.add_sleep(self._sleep)

    def can_execute(self, entity: Entity) -> bool:
        """Whether a callback of this entity may begin now."""
        if entity.is_scheduled:
            return False
        group = entity.callback_group
        return group is None or not self._respects_groups or group.can_execute(entity)

    def _next(
        self,
        timeout: Timeout,
        nodes: Sequence[NodeInterface] | None = None,
        condition: Callable[[], bool] = never,
    ) -> Work | None:
        """The next thing to run; None at the timeout, the condition or the executor's shutdown.

        Raises ExternalShutdownException when the context is shut down.
        """
        if isinstance(timeout, TimeoutObject):
            timeout = timeout.timeout
        self._unpark()
        end, settled = None, timeout != 0
        while not self._is_shutdown and not condition():
            if (work := self._take_from_round(nodes)) is not None:
                return work
            seen = self._sleep.state
            due = self._begin_round(nodes)
            if self._round:
                continue
            if end is None and timeout is not None and timeout >= 0:
                end = time.perf_counter() + timeout
            left = due
            if end is not None:
                rest = end - time.perf_counter()
                if rest <= 0:
                    if settled:
                        return None
                    settle()  # without waiting, only what is here already would be found
                    settled = True
                    continue
                left = rest if due is None else min(due, rest)
            self._sleep.until_ended(seen, left)
        return None

    def _take_from_round(self, nodes: Sequence[NodeInterface] | None) -> Work | None:
        """The next of this round that may still run; skips what was removed meanwhile."""
        usable = self._nodes if nodes is None else nodes
        while self._round:
            try:
                work = self._round.popleft()
            except IndexError:  # another thread spins here, too
                return None
            task, entity, node = work
            if node is not None and node not in usable:
                if task is not None:
                    self._parked.append(task)
            elif task is not None:
                if task.is_runnable():
                    return work
            elif entity is not None and self.can_execute(entity):
                return work
        return None

    def _begin_round(self, nodes: Sequence[NodeInterface] | None) -> float | None:
        """Collect what is ready; the seconds until the next timer is, None without one."""
        if self._ready_tasks and not self._tasks_were_last:
            self._tasks_were_last = True
            self._collect_tasks()
            return None
        self._tasks_were_last = False
        if not self._context.ok():
            if self._is_shutdown:
                return None
            raise ExternalShutdownException
        due = self._collect_entities(nodes)
        if not self._round and self._ready_tasks:
            self._collect_tasks()
        return due

    def _collect_tasks(self) -> None:
        tasks = _emptied(self._ready_tasks)
        tasks.sort(key=lambda task: task.number, reverse=self._youngest_first)
        self._round.extend((task, task.entity, task.parent_node) for task in tasks)

    def _collect_entities(self, nodes: Sequence[NodeInterface] | None) -> float | None:
        first = None
        for entity, node in self._entities(nodes):
            if entity.is_timer:
                wait = entity.nanoseconds_until_due()
                if wait is None:
                    continue
                if wait > 0:
                    first = wait if first is None or wait < first else first
                    continue
            elif not entity.has_work():
                continue
            if self.can_execute(entity):
                self._round.append((None, entity, node))
        return None if first is None else first * 1e-9

    def _entities(self, nodes: Sequence[NodeInterface] | None) -> Layout:
        """Everything that may have work, looked up anew only after something changed."""
        if nodes is not None:
            return [pair for node in nodes for pair in self.entities_of(node)]
        layout = self._layout
        if layout is None:
            version = self._version
            with self._nodes_lock:
                nodes = list(self._nodes)
            layout = [pair for node in nodes for pair in self.entities_of(node)]
            if self._version is version:  # else something changed meanwhile: look anew next time
                self._layout = layout
        return layout

    def entities_of(self, node: Any) -> Layout:
        """The node's entities in the order in which ROS asks them.

        The list is kept with the node, as `rclpy.spin_until_future_complete` adds and removes its
        node each time; here it would keep a node alive that nobody has any more.
        """
        known: tuple[object, Layout] | None = getattr(node, "_layout", None)
        version = self._version
        if known is not None and known[0] is version:
            return known[1]
        kinds = (node.waitables, node.timers, node.subscriptions, node.guards, node.clients)
        layout = [(entity, node) for kind in (*kinds, node.services) for entity in list(kind)]
        node._layout = (version, layout)
        return layout

    def _unpark(self) -> None:
        """Consider the tasks again whose nodes were not among those that were asked for."""
        if self._parked:
            self._ready_tasks.extend(_emptied(self._parked))

    def _keep(self, task: Task[Any]) -> None:
        self._made += 1
        task.number = self._made

    def resume_task(self, task: Task[Any]) -> None:
        """Call a task in the next round; from any thread."""
        self._ready_tasks.append(task)
        self._sleep.end()

    def notify(self) -> None:
        """Wake whoever spins: something arrived; from any thread and from signal handlers."""
        self._sleep.end()


def _emptied(tasks: deque[Task[Any]]) -> list[Task[Any]]:
    """Take all out, though other threads may take some, too."""
    found = []
    with contextlib.suppress(IndexError):
        while True:
            found.append(tasks.popleft())
    return found
