"""A journal of the queue: every step with its inputs and its decisions, for recordings.

A step can be repeated: the same inputs give the same decisions, because the queue is pure. Without
a journal, none of this runs.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import TypeAlias, TypeVar

import msgspec

from taskrpc.robot.protocol import Plan, Pose
from taskrpc.robot.tasks.model import EstimateChange, Task
from taskrpc.robot.tasks.queue.estimate_log import DelayEvent
from taskrpc.robot.tasks.queue.estimated_queue import EstimatedQueue, RemovedTask
from taskrpc.robot.tasks.queue.schedule import Planner
from taskrpc.robot.tasks.queue.task_queue import TaskQueue

_Result = TypeVar("_Result")

_NEXT_TASKS = 8
"""The first tasks of the queue that each step notes."""


class PlanMade(msgspec.Struct, frozen=True):
    """A plan that the robot made during a step."""

    task_id: int
    start: Pose
    seconds: float
    end: Pose


class QueueStart(msgspec.Struct, frozen=True, tag_field="op", tag="queue_start"):
    """The queue when it was made."""

    start_pose: Pose
    tolerance: float
    """Robot seconds of drift that are not logged."""


class QueueStep(
    msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="op", tag="queue"
):
    """One call of a method of `EstimatedQueue`: first its inputs, then its decisions."""

    method: str
    task: Task | None = None
    task_id: int = 0
    priority: int = 0
    now: float = 0.0
    """The robot's clock."""
    seconds: float = 0.0
    """`free_at`, `waited` or `seconds`, as the method has it."""
    pose: Pose | None = None
    cause: str = ""

    plans: tuple[PlanMade, ...] = ()
    result: float = 0.0
    """The accepted estimate, or the planned robot seconds."""
    changes: tuple[EstimateChange, ...] = ()
    """Why the task did not end at its estimate."""
    delays: tuple[DelayEvent, ...] = ()
    """The log's events that are new or have grown."""
    free_at: float = 0.0
    """When the robot will be free for the first queued task."""
    queued: int = 0
    next: tuple[tuple[int, float], ...] = ()
    """The first queued tasks, each with the robot seconds from `free_at` to its end."""


QueueJournal: TypeAlias = Callable[[QueueStart | QueueStep], object]
"""Takes each step; it must be quick and must not raise."""


class JournaledPlanner:
    """A planner that keeps the plans that it made, until `taken`."""

    def __init__(self, plan: Planner) -> None:
        self._plan = plan
        self._made: list[PlanMade] = []

    def __call__(self, task: Task, start: Pose) -> Plan:
        """Plan a task; see `Planner`."""
        plan = self._plan(task, start)
        self._made.append(PlanMade(task.task_id, start, plan.seconds, plan.end))
        return plan

    def taken(self) -> tuple[PlanMade, ...]:
        """Return the plans that were made since the last call."""
        made, self._made = tuple(self._made), []
        return made


class JournaledQueue(EstimatedQueue):
    """An estimated queue that writes a journal; its decisions are those of any other.

    Args:
        plan: see `Planner`.
        start_pose: where the robot will be when the first task begins.
        tolerance: robot seconds of drift that are not logged.
        journal: takes each step.
    """

    def __init__(
        self, plan: Planner, start_pose: Pose, *, tolerance: float, journal: QueueJournal
    ) -> None:
        self._planner = JournaledPlanner(plan)
        super().__init__(TaskQueue(self._planner, start_pose), tolerance=tolerance)
        self._journal = journal
        self._is_inside = False
        """Whether a step runs; the methods that it calls are part of it."""
        self._waiting: QueueStep | None = None
        """The last `set_free_at`, if it decided nothing: the next one replaces it. It is called
        whenever an estimate is read."""
        self._start_pose: Pose | None = start_pose
        """The last noted one; None if a task has begun since."""
        journal(QueueStart(start_pose, tolerance))

    def set_free_at(self, free_at: float, cause: Callable[[], str]) -> None:
        """Set when the robot will be free; see `EstimatedQueue`."""
        given: list[str] = []

        def noted() -> str:
            given.append(cause())
            return given[-1]

        log = self._log_end()
        super().set_free_at(free_at, noted)
        step = QueueStep(method="set_free_at", seconds=free_at)
        if given:
            step = msgspec.structs.replace(step, cause=given[0])
            self._write(step, log)
        else:
            self._waiting = step

    def set_start_pose(self, pose: Pose, cause: str) -> None:
        """Set where the robot will be; see `EstimatedQueue`."""
        if pose == self._start_pose:
            super().set_start_pose(pose, cause)
            return
        step = QueueStep(method="set_start_pose", pose=pose, cause=cause)
        base = super().set_start_pose
        self._noted(step, lambda: base(pose, cause))
        self._start_pose = pose

    def accept(self, task: Task, now: float) -> Task:
        """Queue a task; see `EstimatedQueue`."""
        step = QueueStep(method="accept", task=task, now=now)
        base = super().accept
        return self._noted(
            step, lambda: base(task, now), result=lambda accepted: accepted.accepted_estimate
        )

    def resume(self, task: Task, now: float, *, waited: float) -> None:
        """Queue the task of an earlier server; see `EstimatedQueue`."""
        step = QueueStep(method="resume", task=task, now=now, seconds=waited)
        base = super().resume
        self._noted(step, lambda: base(task, now, waited=waited))

    def remove(self, task_id: int, cause: str) -> RemovedTask:
        """Take a task out; see `EstimatedQueue`."""
        step = QueueStep(method="remove", task_id=task_id, cause=cause)
        base = super().remove
        return self._noted(step, lambda: base(task_id, cause))

    def undo_remove(self, removed: RemovedTask, cause: str) -> None:
        """Return a task to its old place; see `EstimatedQueue`."""
        step = QueueStep(method="undo_remove", task_id=removed.task.task_id, cause=cause)
        base = super().undo_remove
        self._noted(step, lambda: base(removed, cause))

    def reprioritise(self, task_id: int, priority: int) -> Task:
        """Change the priority of a queued task; see `EstimatedQueue`."""
        step = QueueStep(method="reprioritise", task_id=task_id, priority=priority)
        base = super().reprioritise
        return self._noted(step, lambda: base(task_id, priority))

    def begin(self, task: Task) -> float:
        """Note that the first task begins; see `EstimatedQueue`."""
        step = QueueStep(method="begin", task=task)
        base = super().begin
        self._start_pose = None
        return self._noted(step, lambda: base(task), result=lambda seconds: seconds)

    def undo_begin(self, task: Task, pose: Pose, seconds: float) -> None:
        """Return a task that could not begin; see `EstimatedQueue`."""
        step = QueueStep(method="undo_begin", task=task, pose=pose, seconds=seconds)
        base = super().undo_begin
        self._start_pose = None
        self._noted(step, lambda: base(task, pose, seconds))

    def end(self, now: float) -> tuple[EstimateChange, ...]:
        """Note that the execution has ended; see `EstimatedQueue`."""
        step = QueueStep(method="end", now=now)
        base = super().end
        return self._noted(step, lambda: base(now), changes=lambda changes: changes)

    def _noted(
        self,
        step: QueueStep,
        action: Callable[[], _Result],
        *,
        result: Callable[[_Result], float] = lambda _: 0.0,
        changes: Callable[[_Result], tuple[EstimateChange, ...]] = lambda _: (),
    ) -> _Result:
        if self._is_inside:
            return action()
        self._is_inside = True
        log = self._log_end()
        try:
            returned = action()
        finally:
            self._is_inside = False
        step = msgspec.structs.replace(step, result=result(returned), changes=changes(returned))
        self._write(step, log)
        return returned

    def _log_end(self) -> tuple[int, list[DelayEvent]]:
        """Return the number of the log's last event, which may still grow, and that event."""
        last = max(0, self.log.next_number - 1)
        return last, self.log.since(last)

    def _write(self, step: QueueStep, log: tuple[int, list[DelayEvent]]) -> None:
        """Add the decisions to a step and write it; `log` is the end of the log before it."""
        last, before = log
        delays = self.log.since(last)
        if self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            self._journal(waiting)
        self._journal(
            msgspec.structs.replace(
                step,
                plans=self._planner.taken(),
                delays=tuple(delays[1:] if before and delays[:1] == before else delays),
                free_at=self.seconds_ahead(0.0),
                queued=len(self.queue),
                next=tuple(
                    (task.task_id, seconds)
                    for task, seconds in islice(self.queue.ordered(), _NEXT_TASKS)
                ),
            )
        )
