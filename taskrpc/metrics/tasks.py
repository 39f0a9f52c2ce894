"""What is measured of a task server: its queue, its robot, and how long its store takes."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence

from taskrpc.metrics.families import Family, Histogram, Kind, Sample, by_label
from taskrpc.metrics.stores import store_families
from taskrpc.request_ids.ids import ClientKey, Completion
from taskrpc.tasks.manager import TaskManager
from taskrpc.tasks.model import PRIORITY_MAX, PRIORITY_MIN, Task, TaskState
from taskrpc.tasks.records.sqlite_store import SqliteStore
from taskrpc.tasks.records.store import Stored, TaskStore

_ROBOT_STATES = ("idle", "working", "paused")


def task_families(manager: TaskManager) -> list[Family]:
    """What a task manager has to do: `metrics.add(lambda: task_families(server.manager))`."""
    tasks = list(manager.repository.tasks())
    states = Counter(task.state for task in tasks)
    waiting = Counter(task.priority for task in tasks if task.state is TaskState.QUEUED)
    priorities = range(PRIORITY_MIN, PRIORITY_MAX + 1)
    robot = _robot_state(manager)
    return [
        _gauge(
            "taskrpc_queue_tasks",
            "Tasks that wait, by priority (10 runs first).",
            [Sample(waiting[each], {"priority": str(each)}) for each in priorities],
        ),
        _gauge(
            "taskrpc_tasks",
            "Tasks that are remembered, by state; the oldest ended ones are forgotten.",
            [Sample(states[state], {"state": state.value}) for state in TaskState],
        ),
        _gauge(
            "taskrpc_robot_state",
            "1 for the state in which the robot is, 0 for the others.",
            by_label("state", {state: state == robot for state in _ROBOT_STATES}),
        ),
    ]


class MeasuredStore:
    """A `TaskStore` that measures another one: how long it takes until a change is safe."""

    def __init__(self, store: TaskStore) -> None:
        self._store = store
        self._seconds = Histogram()
        self._tasks = 0
        self._failures = 0

    def families(self) -> list[Family]:
        """What was measured, for `Metrics.add`."""
        return [
            Family(
                "taskrpc_store_seconds",
                Kind.HISTOGRAM,
                "How long a change waits until it is stored.",
                self._seconds.samples(),
            ),
            Family(
                "taskrpc_store_tasks_total",
                Kind.COUNTER,
                "Tasks written; each change of a task's state writes it once.",
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
        """Return everything that is remembered; see `TaskStore.load`."""
        return await self._store.load()

    async def apply(
        self,
        saved: Sequence[Task],
        forgotten: Sequence[int] = (),
        completion: Completion | None = None,
        clients: Sequence[ClientKey] = (),
    ) -> None:
        """Remember and forget, all or nothing; see `TaskStore.apply`."""
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
        """Remember whether the queue stands still."""
        await self._store.remember_pause(paused)

    async def clear(self) -> None:
        """Forget everything and begin again with number 1."""
        await self._store.clear()

    async def close(self) -> None:
        """Let others use what the store used."""
        await self._store.close()


def _gauge(name: str, what: str, samples: Sequence[Sample]) -> Family:
    return Family(name, Kind.GAUGE, what, samples)


def _robot_state(manager: TaskManager) -> str:
    if manager.is_paused:
        return "paused"
    return "idle" if manager.running is None else "working"
