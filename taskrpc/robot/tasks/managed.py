"""What the services, the topics and the pages need of the tasks that they show.

`TaskManager` manages the tasks of one robot, `taskrpc.robot.fleet.FleetManager` those of a fleet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from typing import Protocol, TypeAlias

import msgspec

from taskrpc.robot.protocol import Pose, Robot
from taskrpc.robot.tasks.model import EstimateChange, OrderKey, Task
from taskrpc.robot.tasks.queue.estimate_log import DelayLog
from taskrpc.robot.tasks.records.change_feed import ChangeFeed
from taskrpc.robot.tasks.responses import Resumed, TaskResponse
from taskrpc.robot.tasks.robot_guard import Telemetry
from taskrpc.spi import Completion

Completing: TypeAlias = Callable[[TaskResponse], Completion | None]
"""Makes the completion of a request from its response."""


class QueueSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The settings that the managers of one robot and of a fleet have in common."""

    queue_limit: int = 10_000
    """How many tasks may wait."""
    share: int | None = None
    """How many waiting tasks one account may have from one machine; None for no limit."""
    settle: float = 0.1
    """Real seconds that an idle robot waits for more tasks before it takes the first one."""


class RobotStatus(msgspec.Struct, frozen=True):
    """What one robot of a fleet does now."""

    name: str
    state: str
    """`idle`, `running`, `paused` or `away`."""
    pose: Pose | None
    """Where it was at its last report; None if it never reported."""
    task_id: int = 0
    """The task that it executes; 0 for none."""
    is_own: bool = False
    """Whether this server drives it."""
    is_on_map: bool = True
    """Whether its map has the size of this server's map, so that the page can show it there."""


class TaskRecords(Protocol):
    """The remembered tasks."""

    def find(self, task_id: int) -> Task | None:
        """Return the task with this id, None if there is none."""

    def tasks(self) -> Iterable[Task]:
        """Return every remembered task."""

    def ended(self) -> Iterator[Task]:
        """Iterate over the ended tasks: the interrupted ones, then the others, newest first."""

    async def problem(self) -> str:
        """Return why the store cannot be used, "" if it works."""


class ManagedTasks(Protocol):
    """The tasks of one robot or of a fleet, and the operations on them."""

    is_closed: bool
    """Whether `close` has been called."""
    change_feed: ChangeFeed
    """Announces every change to watchers."""

    @property
    def repository(self) -> TaskRecords:
        """Every remembered task."""

    @property
    def queue(self) -> Sized:
        """The queued tasks."""

    @property
    def delays(self) -> DelayLog:
        """Why estimates have changed."""

    @property
    def is_paused(self) -> bool:
        """Whether the queue is paused until `resume`."""

    @property
    def running(self) -> Task | None:
        """The task that this server's robot executes, None if it is idle."""

    @property
    def robot(self) -> Robot:
        """This server's robot."""

    @property
    def speed(self) -> float:
        """Robot seconds in a real second."""

    def begun(self) -> Iterable[tuple[OrderKey, Task]]:
        """Return the tasks that robots execute, each with its place before the queue."""

    def waiting(self, after: OrderKey) -> Iterator[tuple[OrderKey, Task, float]]:
        """Iterate over the stored queued tasks behind a place, in order.

        Each comes with its place and its estimate in robot seconds from now.
        """

    def planned_robot(self, task: Task) -> str:
        """Return the robot that is planned to execute a queued task, "" without a fleet."""

    def waits_for(self, task: Task) -> str:
        """Return which robots of a fleet a queued task waits for while none of them works."""

    def robots(self) -> Sequence[RobotStatus]:
        """Return the robots of a fleet, sorted by name; none without a fleet."""

    def telemetry(self) -> Telemetry:
        """Return what this server's robot reports about itself."""

    def remaining(self) -> float:
        """Return the robot seconds until the running task ends; 0.0 while the robot is idle."""

    def pose(self) -> Pose:
        """Return the pose of this server's robot."""

    def update_estimates(self) -> None:
        """Bring the estimates up to date; call it before reading them."""

    def estimate(self, task_id: int) -> float:
        """Return the robot seconds to a task's end; 0.0 once it has ended."""

    def changes(self, task: Task) -> Sequence[EstimateChange]:
        """Return why a task does not end at its accepted estimate, oldest change first."""

    def preview(
        self, task_type: str, target: str, priority: int, *, account: str = "", machine: str = ""
    ) -> TaskResponse:
        """Return what the response to a new task would be, without queueing it."""

    async def start(self) -> Resumed:
        """Read the store and let the robot begin. Raises StoreError."""

    async def close(self) -> None:
        """Halt the robot, store the running task as INTERRUPTED and close the store."""

    async def cancel(self, task_id: int, *, client: str = "") -> TaskResponse:
        """Cancel a queued or running task."""

    async def drop(self, task_id: int, *, client: str = "") -> TaskResponse:
        """Cancel a queued or interrupted task without running it."""

    async def reprioritise(self, task_id: int, priority: int, *, client: str = "") -> TaskResponse:
        """Move a queued task to another priority."""

    async def requeue(
        self, task_id: int, *, resume: bool = False, client: str = ""
    ) -> TaskResponse:
        """Queue an interrupted, failed or cancelled task again."""

    async def pause(self, *, robot: str = "") -> TaskResponse:
        """Halt the robots during their tasks and begin no other task; or only one robot."""

    async def resume(self, *, robot: str = "") -> TaskResponse:
        """Continue after a pause or a stop of all robots, or of one."""

    async def stop(self, *, client: str = "", robot: str = "") -> TaskResponse:
        """Halt the robots at once and pause the queue, or halt and pause one robot."""
