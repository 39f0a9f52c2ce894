"""The tasks of a fleet as one server sees them, and the changes of the task that it executes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.fleet import rules
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.fleet.store import FleetStore
from taskrpc.robot.protocol import Pose
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.records.change_feed import ChangeFeed

if TYPE_CHECKING:
    from taskrpc.robot.tasks.task_execution import TaskExecution

_RETRY_AFTER = 0.5
_LOOK_TIMEOUT = 0.5  # seconds that a list may wait for the database
_HEALTH_TIMEOUT = 2.0


class FleetRecords:
    """The remembered tasks of the fleet; a `TaskExecution` stores its changes here.

    Args:
        store: the fleet's store.
        change_feed: announces the changes.
        name: this server's robot.
        pose: returns the robot's pose.
    """

    def __init__(
        self, store: FleetStore, change_feed: ChangeFeed, name: str, pose: Callable[[], Pose]
    ) -> None:
        self.change_feed = change_feed
        self.epoch = 0
        """The epoch of this server's lease."""
        self.execution: TaskExecution | None = None
        """What this server's robot executes; None while it is idle."""
        self._store = store
        self._name = name
        self._pose = pose

    @property
    def _state(self) -> FleetState:
        return self._store.state

    def find(self, task_id: int) -> Task | None:
        """Return the task with this id, None if there is none."""
        task = self._state.tasks.get(task_id)
        execution = self.execution
        if task is None or execution is None or execution.task.task_id != task_id:
            return task
        # The database learns the progress only when the lease is renewed.
        progress = execution.task.progress
        if not task.state.is_begun or progress <= task.progress:
            return task
        return msgspec.structs.replace(task, progress=progress)

    def tasks(self) -> Iterable[Task]:
        """Return every remembered task."""
        return self._state.tasks.values()

    def ended(self) -> Iterator[Task]:
        """Iterate over the ended tasks: the interrupted ones, then the others, newest first."""
        return self._state.ended()

    async def problem(self) -> str:
        """Return why the database cannot be used, "" if it works."""
        return await self._store.follow(_HEALTH_TIMEOUT)

    # What a `TaskExecution` calls

    def save(self, task: Task) -> asyncio.Future[None]:
        """Store a change of the task that this server's robot executes.

        Raises:
            Fenced: the lease has ended, so that the database has another state.
            StoreError: nothing was stored; never for the end of a task, which is tried until then.
        """
        if task.state is TaskState.RUNNING and self._is_claimed(task):
            done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            done.set_result(None)  # the claim has stored it
            return done
        return asyncio.ensure_future(self._save(task, self.epoch))

    def _is_claimed(self, task: Task) -> bool:
        stored = self._state.tasks.get(task.task_id)
        return stored is not None and stored.state is not TaskState.PAUSED

    async def _save(self, task: Task, epoch: int) -> None:
        pose = self._pose() if task.state.is_ended else None

        def action(state: FleetState, now: float) -> None:
            rules.update(state, now, self._name, epoch, task, pose)

        while True:
            try:
                await self._store.transact(action)
            except rules.Fenced:
                raise
            except TaskRpcError:
                if not task.state.is_ended:
                    raise
                await asyncio.sleep(_RETRY_AFTER)
            else:
                return

    def announce_unstored(self, task: Task) -> None:
        """Do nothing: what the database has counts for all servers."""

    def announce_progress(self, task_id: int, progress: float) -> None:
        """Announce a task's progress."""
        self.change_feed.announce(task_id)

    async def refreshed(self) -> None:
        """Bring this server's copy up to date; if the database is away, keep the last copy."""
        await self._store.follow(_LOOK_TIMEOUT)
