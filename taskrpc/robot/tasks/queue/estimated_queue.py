"""The task queue with an estimate for each task, and a reason for every second that it changes.

The invariant: for each task, the accepted estimate plus the changes is the time from its acceptance
to its end. Two rules keep it. Every change of the order is logged as a delay. And `set_free_at`
compares the instant at which the robot will be free with the instant that all estimates assume,
and logs the difference (a pause, a slow execution) as a delay too.

Instants and durations are robot seconds on the robot's clock; the caller passes the time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec

from taskrpc.robot.protocol import Pose
from taskrpc.robot.tasks.model import (
    BEFORE_RUNNING_KEY,
    RUNNING_KEY,
    EstimateChange,
    OrderKey,
    Task,
)
from taskrpc.robot.tasks.queue.estimate_log import AcceptedEstimate, DelayLog, merged
from taskrpc.robot.tasks.queue.schedule import Shift
from taskrpc.robot.tasks.queue.task_queue import TaskQueue

_ALL_TASKS = BEFORE_RUNNING_KEY  # an event behind this place counts for the running task too
_BEFORE_EVENTS: OrderKey = (BEFORE_RUNNING_KEY[0] - 1, 0)  # no event counts for a task here
_LISTED_CHANGES = 100


class RemovedTask(msgspec.Struct, frozen=True):
    """A task that was taken out of the queue, with all that `undo_remove` needs."""

    task: Task
    accepted: AcceptedEstimate
    done_at: float
    """When it would have ended, on the robot's clock."""


class EstimatedQueue:
    """A task queue that keeps an estimate for each task; every change of the order is made here.

    Call `set_free_at` first, in the same turn of the event loop, wherever a method gives or shows
    an estimate.

    Args:
        queue: the queued tasks.
        tolerance: robot seconds of drift that are not logged.
    """

    def __init__(self, queue: TaskQueue, *, tolerance: float) -> None:
        self.queue = queue
        self.log = DelayLog()
        """Every delay since the queue was made, the newest ones at least."""
        self._tolerance = tolerance
        self._free_at = 0.0  # when the robot will be free for the first queued task
        self._assumed_free_at = 0.0  # the same instant, as the estimates and the log assume it
        self._running: int | None = None
        self._accepted: dict[int, AcceptedEstimate] = {}  # of the queued and the running tasks

    def drift(self, free_at: float) -> float:
        """Return how much later than the estimates assume the robot will be free."""
        return free_at - self._assumed_free_at

    def set_free_at(self, free_at: float, cause: Callable[[], str]) -> None:
        """Set when the robot will be free; `cause` gives the reason of a drift."""
        self._free_at = free_at
        drift = self.drift(free_at)
        if not self._accepted:
            self._assumed_free_at = free_at
        elif abs(drift) > self._tolerance:
            self.log.add(_ALL_TASKS, drift, cause())
            self._assumed_free_at = free_at

    def set_start_pose(self, pose: Pose, cause: str) -> None:
        """Set where the robot will be when it is free, and why that is not where it was planned."""
        self._log_shifts(self.queue.set_start_pose(pose), cause)

    def accept(self, task: Task, now: float) -> Task:
        """Queue a task; returns it with its estimate, the seconds from `now` to its end."""
        if shifts := self.queue.put(task):
            cause = f"task {task.task_id}, priority {task.priority}, went ahead"
            self._log_shifts(shifts, cause)
        seconds = self.seconds_ahead(now) + self.queue.seconds_through(task)
        accepted = AcceptedEstimate(task.task_id, seconds, now, self.log.mark(), task.order_key)
        self._accepted[task.task_id] = accepted
        estimated = msgspec.structs.replace(task, accepted_estimate=seconds)
        self.queue.replace(estimated)
        return estimated

    def resume(self, task: Task, now: float, *, waited: float) -> None:
        """Queue a task that an earlier server accepted `waited` seconds ago, with its estimate.

        Resume tasks in the order of execution, so that no task delays another.
        """
        estimate = self.accept(task, now).accepted_estimate
        late = waited + estimate - task.accepted_estimate
        self.queue.replace(task)
        self._accepted[task.task_id].seconds = task.accepted_estimate
        self._accepted[task.task_id].at = now - waited
        self.log.add(_ALL_TASKS, late, "the server was restarted", only_task=task.task_id)

    def remove(self, task_id: int, cause: str) -> RemovedTask:
        """Take a task out of the queue.

        `cause` completes the sentence "task 4 …", such as "was cancelled".

        Raises:
            KeyError: it is not queued.
        """
        task = self._queued(task_id)
        removed = RemovedTask(task, self._accepted.pop(task_id), self._done_at(task))
        removed.accepted.move(self.log.mark(), _BEFORE_EVENTS)
        self._log_shifts(self.queue.remove(task_id), f"task {task_id} {cause}")
        return removed

    def undo_remove(self, removed: RemovedTask, cause: str) -> None:
        """Return a task to its old place, with its estimate; `cause` as for `remove`."""
        task = removed.task
        self._log_shifts(self.queue.put(task), f"task {task.task_id} {cause}")
        removed.accepted.move(self.log.mark(), task.order_key)
        self._accepted[task.task_id] = removed.accepted
        late = self._done_at(task) - removed.done_at
        self.log.add(_ALL_TASKS, late, f"it {cause}", only_task=task.task_id)

    def reprioritise(self, task_id: int, priority: int) -> Task:
        """Change the priority of a queued task.

        Raises:
            KeyError: it is not queued.
        """
        before = self.queue.seconds_through(self._queued(task_id))
        cause, accepted = f"moved to priority {priority}", self._accepted[task_id]
        accepted.move(self.log.mark(), RUNNING_KEY)  # the shifts of its move concern the others
        self._log_shifts(self.queue.reprioritise(task_id, priority), f"task {task_id} was {cause}")
        moved = self._queued(task_id)
        accepted.move(self.log.mark(), moved.order_key)
        seconds = self.queue.seconds_through(moved) - before
        self.log.add(_ALL_TASKS, seconds, f"it was {cause}", only_task=task_id)
        return moved

    def begin(self, task: Task) -> float:
        """Note that the first task's execution begins; returns its planned robot seconds."""
        seconds = self.queue.begin(task).seconds
        self._free_at += seconds
        self._assumed_free_at += seconds
        self._running = task.task_id
        self._accepted[task.task_id].move(self.log.mark(), RUNNING_KEY)
        return seconds

    def undo_begin(self, task: Task, pose: Pose, seconds: float) -> None:
        """Return a task to the queue that could not begin; no estimate changes."""
        self._free_at -= seconds
        self._assumed_free_at -= seconds
        self._running = None
        self.queue.set_start_pose(pose)
        self.queue.put(task)
        self._accepted[task.task_id].move(self.log.mark(), task.order_key)

    def end(self, now: float) -> tuple[EstimateChange, ...]:
        """Note that the execution has ended; returns why it did not end at its estimate."""
        assert self._running is not None, "no execution has begun"
        changes = tuple(self.changes(self._running, now))
        del self._accepted[self._running]
        self._running = None
        return changes

    def seconds_ahead(self, now: float) -> float:
        """Return the robot seconds from `now` until the first queued task can begin."""
        return self._free_at - now

    def estimate(self, task_id: int, now: float) -> float:
        """Return the robot seconds from `now` to the task's end; 0.0 once it has ended."""
        if task_id not in self._accepted:
            return 0.0
        # The clock has moved since `set_free_at`: in the last moment, the difference is below 0.
        return max(0.0, self._seconds_to_end(task_id, now))

    def _seconds_to_end(self, task_id: int, now: float) -> float:
        task = self.queue.find(task_id)
        return self.seconds_ahead(now) + (self.queue.seconds_through(task) if task else 0.0)

    def changes(self, task_id: int, now: float) -> list[EstimateChange]:
        """Return why a queued or running task does not end at its estimate, oldest change first."""
        accepted = self._accepted.get(task_id)
        if accepted is None:
            return []
        events = accepted.select(self.log.since(accepted.first_event))
        changes = [EstimateChange(event.seconds, event.cause) for event in events]
        if not self.log.is_complete_since(accepted.first_event):
            late = now - accepted.at + self._seconds_to_end(task_id, now) - accepted.seconds
            forgotten = late - sum(change.seconds for change in changes)
            changes.insert(0, EstimateChange(forgotten, "changes before these"))
        return merged(iter(changes), at_most=_LISTED_CHANGES)

    def _done_at(self, task: Task) -> float:
        return self._assumed_free_at + self.queue.seconds_through(task)

    def _queued(self, task_id: int) -> Task:
        task = self.queue.find(task_id)
        if task is None:
            raise KeyError(task_id)
        return task

    def _log_shifts(self, shifts: Iterable[Shift], cause: str) -> None:
        for shift in shifts:
            self.log.add(shift.after, shift.seconds, cause)
