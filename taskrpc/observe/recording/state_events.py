"""The decisions of a recording as events of the live page: tasks, results, scans, robot, paths."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

import srvgen
from taskrpc.observe.recording.decisions import PauseChange, ProgressMade
from taskrpc.observe.recording.mcap_file import Message, RecordingError
from taskrpc.observe.recording.player import playable_class
from taskrpc.observe.recording.replay import QueueReplay
from taskrpc.observe.recording.timed_event import TimedEvent
from taskrpc.robot.journal import RobotStart, RobotStep
from taskrpc.robot.tasks.model import RUNNING_KEY, Task
from taskrpc.robot.tasks.page_events import (
    MAX_ENDED,
    MAX_MOVES,
    MAX_QUEUE,
    MIN_MOVE,
    concerns,
    result_json,
    scan_json,
    task_json,
)
from taskrpc.robot.tasks.queue.estimate_log import DelayEvent
from taskrpc.robot.tasks.queue.journal import QueueStart, QueueStep

_PERIOD = 0.1  # seconds between two events of the same name
_BURST = 0.02  # seconds in which the changes of one decision follow each other
_MOST_TASKS_EVENTS, _MOST_ROBOT_EVENTS, _MOST_RESULTS = 1500, 20_000, 2000


class RobotClock:
    """Converts the time of day to the robot's clock, from pairs of both in the recording."""

    def __init__(self) -> None:
        self.speed = 1.0
        self._pair: tuple[float, float] | None = None

    def note(self, time: float, now: float) -> None:
        """Note what both clocks show."""
        self._pair = time, now

    def now(self, time: float) -> float | None:
        """Return what the robot's clock shows at a time of day; None before the first pair."""
        if self._pair is None:
            return None
        return self._pair[1] + (time - self._pair[0]) * self.speed


class TaskEvents:
    """Makes the events `tasks`, `scan` and `task`, which has the result of an ended task."""

    def __init__(self, clock: RobotClock, span: float) -> None:
        self.begun: int | None = None
        """The task that the robot executes."""
        self._clock = clock
        self._period = max(_PERIOD, span / _MOST_TASKS_EVENTS)
        self._result_period = span / _MOST_RESULTS
        self._result_at = float("-inf")  # the time of the last result
        self._queue: QueueReplay | None = None
        self._tasks: dict[int, Task] = {}
        self._ended: deque[int] = deque(maxlen=MAX_ENDED)
        self._ended_as: dict[int, str] = {}
        """The states of all ended tasks."""
        self._counts: Counter[str] = Counter()
        self._moves: deque[dict[str, Any]] = deque(maxlen=MAX_MOVES)
        self._counted = -1, 0.0  # the number of the last delay, and its seconds
        self._paused = False
        self._revision = 0
        self._last = float("-inf")  # the time of the last event
        self._changed_at: float | None = None  # the first change since then

    def take(
        self, time: float, decision: QueueStart | QueueStep | ProgressMade | PauseChange
    ) -> None:
        """Take a decision. Raises RecordingError if it is impossible after the earlier ones."""
        if not (isinstance(decision, QueueStep) and decision.method == "set_free_at"):
            self._changed(time)
        match decision:
            case QueueStart():
                self._queue = QueueReplay(decision)
            case QueueStep():
                self._step(time, decision)
            case ProgressMade() if decision.task_id in self._tasks:
                task = self._tasks[decision.task_id]
                progressed = msgspec.structs.replace(task, progress=decision.progress)
                self._tasks[decision.task_id] = progressed
            case PauseChange():
                self._paused = decision.paused

    def change(self, time: float, task: Task) -> Iterator[TimedEvent]:
        """Take a new value of a task; yields its result if it has ended."""
        self._changed(time)
        if (before := self._ended_as.pop(task.task_id, None)) is not None:
            self._counts[before] -= 1
            if task.task_id in self._ended:
                self._ended.remove(task.task_id)
        if task.state.is_ended:
            self._ended_as[task.task_id] = task.state.value
            self._counts[task.state.value] += 1
            if len(self._ended) == MAX_ENDED:  # only the newest are shown
                self._tasks.pop(self._ended.pop(), None)
            self._ended.appendleft(task.task_id)
        self._tasks[task.task_id] = msgspec.structs.replace(task, result="", changes=())
        if task.state.is_begun:
            self.begun = task.task_id
        elif self.begun == task.task_id and task.state.is_ended:
            self.begun = None
        if task.state.is_ended and time - self._result_at >= self._result_period:
            self._result_at = time
            yield from _results(time, task)

    def due(self, time: float) -> Iterator[TimedEvent]:
        """Yield the event of earlier changes if its time has come."""
        if self._changed_at is None:
            return
        when = max(self._changed_at + _BURST, self._last + self._period)
        if when <= time:
            yield self._event(when)

    def finish(self, time: float) -> Iterator[TimedEvent]:
        """Yield the event of the last changes, at the end of the recording."""
        if self._changed_at is not None:
            yield self._event(time)

    def _changed(self, time: float) -> None:
        if self._changed_at is None:
            self._changed_at = time

    def _step(self, time: float, step: QueueStep) -> None:
        if self._queue is None:
            raise RecordingError("the recording has a step of the queue before its start")
        if step.method in ("accept", "resume", "end"):
            self._clock.note(time, step.now)
        if step.method == "begin" and step.task is not None:
            self.begun = step.task.task_id
        waiting = [] if not step.delays else [task for task, _ in self._ordered()]
        self._queue.step(step)
        for delay in step.delays:
            number, counted = self._counted
            self._counted = delay.number, delay.seconds
            grown = delay.seconds - (counted if delay.number == number else 0.0)
            self._move(time, delay, grown, waiting)

    def _move(
        self, time: float, delay: DelayEvent, seconds: float, waiting: Sequence[Task]
    ) -> None:
        if abs(seconds) < MIN_MOVE:
            return
        for task in waiting:
            if concerns(delay, task, seconds):
                self._changed(time)
                move = {"task_id": task.task_id, "seconds": round(seconds, 3)}
                self._moves.appendleft({**move, "cause": delay.cause, "t": time})

    def _ordered(self) -> list[tuple[Task, float]]:
        if self._queue is None:
            return []
        rows = self._queue.queue.queue.ordered(RUNNING_KEY)
        return [row for row, _ in zip(rows, range(MAX_QUEUE), strict=False)]

    def _event(self, time: float) -> TimedEvent:
        self._last, self._changed_at = time, None
        self._revision += 1
        now, queue = self._clock.now(time), self._queue
        ahead = 0.0 if queue is None or now is None else queue.queue.seconds_ahead(now)
        rows = self._ordered()
        running = self._tasks.get(self.begun) if self.begun is not None else None
        queued = 0 if queue is None else len(queue.queue.queue)
        rows = [(task, ahead + seconds) for task, seconds in rows]
        known = [self._tasks.get(task.task_id, task) for task, _ in rows]
        shown = [
            task_json(msgspec.structs.replace(each, priority=task.priority), max(0.0, seconds))
            for each, (task, seconds) in zip(known, rows, strict=True)
        ]
        return TimedEvent(
            time,
            "tasks",
            {
                "revision": self._revision,
                "t": time,
                "paused": self._paused,
                "queued": queued,
                "running": task_json(running, ahead) if running else None,
                "queue": shown,
                "more": max(0, queued - len(shown)),
                "ended": [task_json(self._tasks[each], 0.0) for each in self._ended],
                "counts": {name: count for name, count in self._counts.items() if count},
                "moves": list(self._moves),
            },
        )


def _results(time: float, task: Task) -> Iterator[TimedEvent]:
    """Yield what the page shows of an ended task: its scan, its result and its changes."""
    if (scan := scan_json(task)) is not None:
        yield TimedEvent(time, "scan", scan)
    changes = [{"seconds": each.seconds, "cause": each.cause} for each in task.changes]
    shown = {"task_id": task.task_id, "result": result_json(task), "changes": changes}
    yield TimedEvent(time, "task", shown)


class RobotEvents:
    """Makes the `robot` and `path` events."""

    def __init__(self, clock: RobotClock, span: float) -> None:
        self._clock = clock
        self._period = max(_PERIOD, span / _MOST_ROBOT_EVENTS)
        self._last = float("-inf")
        self._pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self._end: float | None = None  # robot seconds; None while the robot is halted
        self._battery: float | None = None
        self._odometer: float | None = None
        self._class: Any = None

    def start(self, time: float, start: RobotStart) -> Iterator[TimedEvent]:
        """Yield the robot before its first task."""
        standing = start.standing
        yield from self.take(time, RobotStep(method="start", standing=standing), None)

    def take(self, time: float, step: RobotStep, task_id: int | None) -> Iterator[TimedEvent]:
        """Yield what a step of the motion changes; `task_id` is the task that begins."""
        self._end = step.end
        if step.method == "go":
            self._clock.note(time, step.now)
        if (standing := step.standing) is not None:
            pose = standing.pose
            self._pose = pose.x, pose.y, pose.theta
            self._battery, self._odometer = standing.battery, standing.odometer
        if step.method == "assign":
            points = [self._pose[:2], *step.waypoints] if step.waypoints else []
            yield TimedEvent(
                time, "path", {"task_id": task_id if points else None, "points": points}
            )
        yield self._event(time)

    def take_pose(self, time: float, message: Message) -> Iterator[TimedEvent]:
        """Yield a published pose."""
        if time - self._last < self._period * 0.9:
            return
        if self._class is None:
            self._class = playable_class(message.topic)
        pose = srvgen.from_cdr(self._class, message.data).pose
        turn = pose.orientation
        self._pose = pose.position.x, pose.position.y, heading(turn.z, turn.w)
        yield self._event(time)

    def _event(self, time: float) -> TimedEvent:
        self._last = time
        x, y, theta = self._pose
        now = self._clock.now(time)
        left = 0.0 if now is None or self._end is None else max(0.0, self._end - now)
        return TimedEvent(
            time,
            "robot",
            {
                "t": time,
                "x": round(x, 4),
                "y": round(y, 4),
                "theta": round(theta, 4),
                "moving": self._end is not None,
                "remaining": round(left, 3),
                "battery": None if self._battery is None else round(self._battery, 1),
                "odometer": None if self._odometer is None else round(self._odometer, 2),
            },
        )


def heading(z: float, w: float) -> float:
    """Return the heading of a quaternion that turns around the z axis, in radians."""
    return math.remainder(2 * math.atan2(z, w), math.tau)
