"""When each task will be done, and an account of every second by which that moved.

The invariant: for each task, what it was promised plus its changes is the time from its acceptance
to its end. It holds because everything that happens is entered as an event, and because `reckon`
compares, whenever it matters, the instant at which the robot will be free with the instant that
all promises presume; the difference (a pause, a slow run) is an event too.

Instants and spans are robot seconds, on the robot's clock; the caller says what time it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec

from taskrpc.robot.protocol import Pose
from taskrpc.tasks.model import EstimateChange, Key, Task
from taskrpc.tasks.queue.estimates import EventLog, Promise, joined
from taskrpc.tasks.queue.schedule import RUNNING_KEY, Shift
from taskrpc.tasks.queue.task_queue import TaskQueue

_EVERYBODY: Key = (RUNNING_KEY[0] - 1, 0)  # the running task too
_NOWHERE: Key = (RUNNING_KEY[0] - 2, 0)  # before all that events concern
_LISTED_CHANGES = 100


class Removed(msgspec.Struct, frozen=True):
    """A task that was taken out of the queue, and all that it takes to put it back."""

    task: Task
    promise: Promise
    done_at: float
    """When it would have been done."""


class Timetable:
    """The queue with its promises; every change of the order goes through here.

    Call `reckon` first, in the same turn, wherever a method promises or shows an estimate.

    Args:
        queue: the tasks that wait.
        tolerance: robot seconds of drift that are not worth an event.
    """

    def __init__(self, queue: TaskQueue, *, tolerance: float) -> None:
        self.queue = queue
        self.log = EventLog()
        self._tolerance = tolerance
        self._free_at = 0.0
        self._presumed = 0.0
        self._running: int | None = None
        self._promises: dict[int, Promise] = {}

    def drift(self, free_at: float) -> float:
        """By how much later than presumed the robot will be free for the first queued task."""
        return free_at - self._presumed

    def reckon(self, free_at: float, cause: Callable[[], str]) -> None:
        """Say when the robot will be free, and why, if that differs from what was presumed."""
        self._free_at = free_at
        drift = self.drift(free_at)
        if not self._promises:
            self._presumed = free_at
        elif abs(drift) > self._tolerance:
            self.log.add(_EVERYBODY, drift, cause())
            self._presumed = free_at

    def rebase(self, pose: Pose, cause: str) -> None:
        """Say where the robot will be when it is free, if it is not where it was expected."""
        self._enter(self.queue.rebase(pose), cause)

    def accept(self, task: Task, now: float) -> Task:
        """Queue a task and return it with its estimate: seconds from `now` until it is done."""
        if shifts := self.queue.put(task):
            self._enter(shifts, f"task {task.task_id}, priority {task.priority}, went ahead")
        seconds = self.seconds_ahead(now) + self.queue.seconds_through(task)
        promise = Promise(task.task_id, seconds, now, self.log.mark(), task.key)
        self._promises[task.task_id] = promise
        accepted = msgspec.structs.replace(task, accepted_estimate=seconds)
        self.queue.amend(accepted)
        return accepted

    def resume(self, task: Task, now: float, *, waited: float) -> None:
        """Queue a task that an earlier server accepted, `waited` seconds ago, and keep its promise.

        Resume tasks in the order of run, so that none delays another.
        """
        estimate = self.accept(task, now).accepted_estimate
        late = waited + estimate - task.accepted_estimate
        self.queue.amend(task)
        self._promises[task.task_id].seconds = task.accepted_estimate
        self._promises[task.task_id].at = now - waited
        self.log.add(_EVERYBODY, late, "the server was restarted", only=task.task_id)

    def remove(self, task_id: int, cause: str) -> Removed:
        """Take a queued task out; raises KeyError if it does not wait.

        `cause` completes the sentence "task 4 …", such as "was cancelled".
        """
        task = self._queued(task_id)
        removed = Removed(task, self._promises.pop(task_id), self._done_at(task))
        removed.promise.move(self.log.mark(), _NOWHERE)
        self._enter(self.queue.remove(task_id), f"task {task_id} {cause}")
        return removed

    def undo_remove(self, removed: Removed, cause: str) -> None:
        """Put a task back at its old place, with its promise; `cause` as for `remove`."""
        task = removed.task
        self._enter(self.queue.put(task), f"task {task.task_id} {cause}")
        removed.promise.move(self.log.mark(), task.key)
        self._promises[task.task_id] = removed.promise
        late = self._done_at(task) - removed.done_at
        self.log.add(_EVERYBODY, late, f"it {cause}", only=task.task_id)

    def rerank(self, task_id: int, priority: int) -> Task:
        """Move a queued task to another priority; raises KeyError if it does not wait."""
        before = self.queue.seconds_through(self._queued(task_id))
        cause, promise = f"moved to priority {priority}", self._promises[task_id]
        promise.move(self.log.mark(), RUNNING_KEY)  # its own move concerns only the others
        self._enter(self.queue.rerank(task_id, priority), f"task {task_id} was {cause}")
        moved = self._queued(task_id)
        promise.move(self.log.mark(), moved.key)
        seconds = self.queue.seconds_through(moved) - before
        self.log.add(_EVERYBODY, seconds, f"it was {cause}", only=task_id)
        return moved

    def begin(self, task: Task) -> float:
        """Note that a task's run begins, and return the seconds that it is planned to take."""
        seconds = self.queue.begin(task).seconds
        self._free_at += seconds
        self._presumed += seconds
        self._running = task.task_id
        self._promises[task.task_id].move(self.log.mark(), RUNNING_KEY)
        return seconds

    def undo_begin(self, task: Task, pose: Pose, seconds: float) -> None:
        """Put a task back that could not begin after all; nobody's promise changes."""
        self._free_at -= seconds
        self._presumed -= seconds
        self._running = None
        self.queue.rebase(pose)
        self.queue.put(task)
        self._promises[task.task_id].move(self.log.mark(), task.key)

    def end(self, now: float) -> tuple[EstimateChange, ...]:
        """Note that the run has ended, and return why it did not end when it was promised."""
        assert self._running is not None, "only a run that began can end"
        changes = tuple(self.changes(self._running, now))
        del self._promises[self._running]
        self._running = None
        return changes

    def seconds_ahead(self, now: float) -> float:
        """Robot seconds from `now` until the first queued task can begin."""
        return self._free_at - now

    def estimate(self, task_id: int, now: float) -> float:
        """Robot seconds from `now` until a task that waits or runs is done; 0.0 for any other."""
        if task_id not in self._promises:
            return 0.0
        task = self.queue.find(task_id)
        return self.seconds_ahead(now) + (self.queue.seconds_through(task) if task else 0.0)

    def changes(self, task_id: int, now: float) -> list[EstimateChange]:
        """Why a task that waits or runs will not be done when it was promised, oldest first."""
        promise = self._promises.get(task_id)
        if promise is None:
            return []
        events = promise.among(self.log.since(promise.number))
        changes = [EstimateChange(event.seconds, event.cause) for event in events]
        if not self.log.remembers(promise.number):
            late = now - promise.at + self.estimate(task_id, now) - promise.seconds
            forgotten = late - sum(change.seconds for change in changes)
            changes.insert(0, EstimateChange(forgotten, "changes before these"))
        return joined(iter(changes), at_most=_LISTED_CHANGES)

    def _done_at(self, task: Task) -> float:
        return self._presumed + self.queue.seconds_through(task)

    def _queued(self, task_id: int) -> Task:
        task = self.queue.find(task_id)
        if task is None:
            raise KeyError(task_id)
        return task

    def _enter(self, shifts: Iterable[Shift], cause: str) -> None:
        for shift in shifts:
            self.log.add(shift.after, shift.seconds, cause)
