"""The scheduler of an executor: collects everything that is ready in rounds.

Rounds of tasks and rounds of entities alternate. Each ready entity runs at most once in a round, so
a busy timer or subscription cannot starve a service.
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
    """The remaining seconds of a timeout, which may change between two spins."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout


Timeout: TypeAlias = float | TimeoutObject | None
"""Seconds; None and negative values mean no timeout."""

Work: TypeAlias = tuple[Task[Any] | None, Entity | None, Any]
"""One piece of work: a task, with its entity if it has one, or only an entity; and the node."""

Layout: TypeAlias = list[tuple[Entity, Any]]
"""Entities, each with its node, in the order in which the scheduler queries them."""


def never() -> bool:
    """The condition that is never true."""
    return False


class Scheduler:
    """Knows the nodes and the tasks, waits for work, and chooses what runs next."""

    _respects_groups: ClassVar[bool] = True
    """Whether callback groups limit what may run; else, no callback waits for one that awaits."""

    def __init__(self, *, context: Context | None = None) -> None:
        self._context = get_default_context() if context is None else context
        if self._context.handle is None:
            raise RuntimeError(
                "Context must be initialized before an executor can be created: rclpy.init() comes"
                " first"
            )
        self._context.check_valid(
            "failed to create guard_condition"
        )  # each executor of ROS has one
        self._nodes: dict[NodeInterface, None] = {}
        self._nodes_lock = threading.RLock()
        self._sleep = Sleep()
        self._version = object()
        """Replaced when an entity was created or destroyed; layouts of other versions are old."""
        self._layout: Layout | None = None
        """The entities of all nodes; None while they must be collected again."""
        self._round: deque[Work] = deque()
        """The work of this round that has not run yet."""
        self._tasks_were_last = False
        """Whether the last round had tasks; then the next one has entities."""
        self._ready_tasks: deque[Task[Any]] = deque()
        """Tasks to call in the next round."""
        self._parked: deque[Task[Any]] = deque()
        """Tasks of nodes that were not among the nodes of the last `wait_for_ready_callbacks`."""
        self._waiting: set[Task[Any]] = set()
        """Coroutines of callbacks that await something."""
        self._task_count = 0
        """How many tasks were created; the count is the number of the newest task."""
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
        """Wait for the next work and return it.

        Returns None after the timeout, when the condition is true or the executor is shut down.
        Raises ExternalShutdownException when the context is shut down, and RCLError if it was
        before the call and there is a timeout.
        """
        if isinstance(timeout, TimeoutObject):
            timeout = timeout.timeout
        self._unpark()
        end, settled = None, timeout != 0
        while not self._is_shutdown and not condition():
            if (work := self._take_from_round(nodes)) is not None:
                return work
            seen = self._sleep.state
            try:
                due = self._begin_round(nodes)
            except ExternalShutdownException:
                if end is None and timeout is not None and timeout > 0:
                    self._context.check_valid("failed to create timer")  # ROS's timer of the wait
                raise
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
                    settle()  # without it, only items that have already arrived would be found
                    settled = True
                    continue
                left = rest if due is None else min(due, rest)
            self._sleep.until_ended(seen, left)
        return None

    def _take_from_round(self, nodes: Sequence[NodeInterface] | None) -> Work | None:
        """Take the next work of this round that may still run; skips removed nodes and entities."""
        usable = self._nodes if nodes is None else nodes
        while self._round:
            try:
                work = self._round.popleft()
            except IndexError:  # another thread took the last piece
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
        """Collect what is ready; returns the seconds until the next timer is due, or None."""
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
        tasks.sort(key=lambda task: task.number)
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
        """All entities that may have work; collected again only after a change."""
        if nodes is not None:
            return [pair for node in nodes for pair in self.entities_of(node)]
        layout = self._layout
        if layout is None:
            version = self._version
            with self._nodes_lock:
                nodes = list(self._nodes)
            layout = [pair for node in nodes for pair in self.entities_of(node)]
            if self._version is version:  # else there was a change: collect again next time
                self._layout = layout
        return layout

    def entities_of(self, node: Any) -> Layout:
        """The entities of a node, in the order in which ROS queries them.

        The node keeps the list, because `rclpy.spin_until_future_complete` adds and removes its
        node each time. The executor must not keep it: it would keep an abandoned node alive.
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
        """Make the parked tasks ready again."""
        if self._parked:
            self._ready_tasks.extend(_emptied(self._parked))

    def _keep(self, task: Task[Any]) -> None:
        self._task_count += 1
        task.number = self._task_count

    def resume_task(self, task: Task[Any]) -> None:
        """Call a task again in the next round; from any thread."""
        self._ready_tasks.append(task)
        self._sleep.end()

    def notify(self) -> None:
        """Wake the spinning threads for an item; any thread or signal handler may call this."""
        self._sleep.end()


def _emptied(tasks: deque[Task[Any]]) -> list[Task[Any]]:
    """Remove and return all tasks; other threads may remove some at the same time."""
    found = []
    with contextlib.suppress(IndexError):
        while True:
            found.append(tasks.popleft())
    return found
