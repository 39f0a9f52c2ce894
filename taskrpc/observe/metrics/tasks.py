"""Metrics of a task server: its queue, its robot, and the duration of its store's changes."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence

from taskrpc.observe.metrics.collector import store_families
from taskrpc.observe.metrics.prometheus import Family, Histogram, Kind, Sample, by_label
from taskrpc.robot.tasks.managed import ManagedTasks
from taskrpc.robot.tasks.model import PRIORITY_MAX, PRIORITY_MIN, Task, TaskState
from taskrpc.robot.tasks.records.history import History
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.robot.tasks.records.store import Stored, TaskStore
from taskrpc.spi import ClientKey, Completion

_ROBOT_STATES = ("idle", "working", "paused")


def task_families(manager: ManagedTasks) -> list[Family]:
    """Return a task manager's metrics: `metrics.add(lambda: task_families(server.manager))`."""
    tasks = list(manager.repository.tasks())
    states = Counter(task.state for task in tasks)
    waiting = Counter(task.priority for task in tasks if task.state is TaskState.QUEUED)
    priorities = range(PRIORITY_MIN, PRIORITY_MAX + 1)
    robot = _robot_state(manager)
    return [
        _gauge(
            "taskrpc_queue_tasks",
            "Queued tasks, by priority (10 runs first).",
            [Sample(waiting[each], {"priority": str(each)}) for each in priorities],
        ),
        _gauge(
            "taskrpc_tasks",
            "Remembered tasks, by state; the server forgets the oldest ended tasks.",
            [Sample(states[state], {"state": state.value}) for state in TaskState],
        ),
        _gauge(
            "taskrpc_robot_state",
            "1 for the robot's current state, 0 for the other states.",
            by_label("state", {state: state == robot for state in _ROBOT_STATES}),
        ),
    ]


class MeasuredStore:
    """A `TaskStore` around another one that measures how long each change takes."""

    def __init__(self, store: TaskStore) -> None:
        self._store = store
        self._seconds = Histogram()
        self._tasks = 0
        self._failures = 0
        if hasattr(store, "open_now"):  # only stores in files have it
            self.open_now = store.open_now

    @property
    def history(self) -> History:
        """Which ended tasks are kept."""
        return self._store.history

    def families(self) -> list[Family]:
        """Return the measurements, for `Metrics.add`."""
        return [
            Family(
                "taskrpc_store_seconds",
                Kind.HISTOGRAM,
                "Seconds that a change takes until it is stored.",
                self._seconds.samples(),
            ),
            Family(
                "taskrpc_store_tasks_total",
                Kind.COUNTER,
                "Tasks that were written; each change of a task's state writes it once.",
                [Sample(self._tasks)],
            ),
            Family(
                "taskrpc_store_failures_total",
                Kind.COUNTER,
                "Changes that the store refused.",
                [Sample(self._failures)],
            ),
            *(store_families(self._store) if isinstance(self._store, SqliteStore) else ()),
        ]

    async def load(self) -> Stored:
        """Return everything that the store remembers; see `TaskStore.load`."""
        return await self._store.load()

    async def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
    ) -> None:
        """Remember and forget tasks and completions; see `TaskStore.apply`."""
        now = asyncio.get_running_loop().time
        began = now()
        try:
            await self._store.apply(saved, forgotten, completion, clients)
        except BaseException:
            self._failures += 1
            raise
        self._seconds.observe(now() - began)
        self._tasks += len(saved)

    async def remember_pause(self, paused: bool) -> None:
        """Remember whether the queue is paused."""
        await self._store.remember_pause(paused)

    async def clear(self) -> None:
        """Forget everything and begin again with task 1."""
        await self._store.clear()

    async def close(self) -> None:
        """Release what the store uses."""
        await self._store.close()


def _gauge(name: str, what: str, samples: Sequence[Sample]) -> Family:
    return Family(name, Kind.GAUGE, what, samples)


def _robot_state(manager: ManagedTasks) -> str:
    if manager.is_paused:
        return "paused"
    return "idle" if manager.running is None else "working"
