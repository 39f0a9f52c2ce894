"""A recording as the live page's events: the same JSON as the event stream, each with its time.

The events `tasks`, `robot`, `path`, `scan` and `graph` are whole states: at any time, the newest of
each name is what the page shows. The events `calls` add up. Long recordings are thinned out, so
that a browser can keep all events in memory.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

import srvgen
from taskrpc.recording.calls import CallReader, RecordedCall, is_about_calls
from taskrpc.recording.decisions import (
    DECISIONS_TOPIC,
    Decision,
    PauseChange,
    ProgressMade,
    RunStart,
    TaskChange,
    decision_of,
)
from taskrpc.recording.mcap_file import Message, Recording, RecordingError
from taskrpc.recording.player import playable_class
from taskrpc.recording.replay import QueueReplay
from taskrpc.robot.journal import RobotStart, RobotStep, WorldFacts
from taskrpc.tasks.model import BEFORE_RUNNING_KEY, RUNNING_KEY, Task, TaskState
from taskrpc.tasks.queue.estimate_log import DelayEvent
from taskrpc.tasks.queue.journal import QueueStart, QueueStep

PROTOCOL = 1
"""The version of the events, as on the live page."""
MAX_QUEUE, MAX_ENDED, MAX_MOVES, MAX_NODES, MAX_CALLS = 50, 30, 20, 100, 100
"""The most entries of each list of one event, as on the live page."""

_PERIOD = 0.1  # seconds between two events of the same name
_BURST = 0.02  # seconds in which the changes of one decision follow each other
_CALLS_PERIOD = 0.2
_MOST_TASKS_EVENTS, _MOST_ROBOT_EVENTS, _MOST_CALLS = 1500, 20_000, 50_000
_SLOW = 0.05  # seconds after which a call is shown although it has not ended
_SAMPLED = 1000  # the newest calls, for the percentiles
_MIN_MOVE, _MIN_COMMON_MOVE = 0.1, 0.5  # seconds; smaller changes of an estimate are not shown
_POSE = "geometry_msgs/msg/PoseStamped"


class TimedEvent(msgspec.Struct, frozen=True):
    """An event of the live page, with its time."""

    t: float
    """Seconds since 1970."""
    event: str
    """Its name, such as `tasks`."""
    data: dict[str, Any]


class Timeline:
    """All events of a recording, in the order of time; iterate over it to get them.

    Args:
        recording: the file; recordings without decisions have only `hello`, `calls` and `graph`.

    Raises:
        RecordingError: the recording has no message, or its decisions contradict each other.
    """

    def __init__(self, recording: Recording) -> None:
        self.begin, self.end = _span(recording)
        """Seconds since 1970 of the first and the last message."""
        self.recording = recording
        events = [*_Reader(self.begin, self.end).events(recording)]
        events.sort(key=lambda event: event.t)
        hello = next(event for event in events if event.event == "hello")
        span = {"name": recording.path.name, "begin": self.begin, "end": self.end}
        hello.data["recording"] = {**span, "problem": recording.problem}
        self._events = [hello, *(event for event in events if event is not hello)]
        self._times = [event.t for event in self._events]

    def __iter__(self) -> Iterator[TimedEvent]:
        return iter(self._events)

    @property
    def hello(self) -> TimedEvent:
        """The first event: the server, the map, and the span of the recording."""
        return self._events[0]

    def events_between(self, begin: float, end: float) -> list[TimedEvent]:
        """Return the events from `begin` to before `end`, in seconds since 1970."""
        return self._events[bisect_left(self._times, begin) : bisect_left(self._times, end)]

    def state_at(self, time: float) -> dict[str, TimedEvent]:
        """Return what the page shows at a time: the newest event of each state, by its name."""
        newest = {event.event: event for event in self.events_between(self.begin, time)}
        newest.pop("calls", None)
        return newest

    def lines(self) -> Iterator[bytes]:
        """Iterate over the events as lines of JSON: `{"t":…,"event":…,"data":{…}}`."""
        encode = msgspec.json.Encoder().encode
        for event in self._events:
            yield encode(event) + b"\n"


def _span(recording: Recording) -> tuple[float, float]:
    times = [0, 0]
    for message in recording.messages():
        times = [min(times[0] or message.time, message.time), max(times[1], message.time)]
    if not times[1]:
        raise RecordingError(f"{recording.path} has no message")
    return times[0] / 1e9, times[1] / 1e9


class _Reader:
    """Makes the events of a recording in one pass over its messages."""

    def __init__(self, begin: float, end: float) -> None:
        self._begin = begin
        self._calls = CallReader()
        self._run: RunStart | None = None
        self._world: WorldFacts | None = None
        self._clock = _RobotClock()
        self._tasks = _Tasks(self._clock, max(_PERIOD, (end - begin) / _MOST_TASKS_EVENTS))
        self._robot = _Robot(self._clock, max(_PERIOD, (end - begin) / _MOST_ROBOT_EVENTS))

    def events(self, recording: Recording) -> Iterator[TimedEvent]:
        time = self._begin
        for message in recording.messages():
            time = message.time / 1e9
            yield from self._tasks.due(time)
            if message.topic.name == DECISIONS_TOPIC:
                yield from self._take(time, decision_of(message))
            elif message.topic.type_name == _POSE:
                yield from self._robot.take_pose(time, message)
            elif is_about_calls(message.topic):
                self._calls.take(message)
        yield from self._tasks.due(math.inf)
        calls = sorted(self._calls.calls, key=lambda call: call.begin)
        yield from _call_events(calls)
        yield from self._graph(calls)
        yield TimedEvent(self._begin, "hello", self._hello())

    def _take(self, time: float, decision: Decision) -> Iterator[TimedEvent]:
        match decision:
            case RunStart():
                self._run, self._clock.speed = decision, decision.speed
            case RobotStart():
                self._world = decision.world
                yield from self._robot.start(time, decision)
            case RobotStep():
                yield from self._robot.take(time, decision, self._tasks.begun)
            case TaskChange():
                self._tasks.change(time, decision.task)
                yield from _scan(time, decision.task)
            case QueueStart() | QueueStep() | ProgressMade() | PauseChange():
                self._tasks.take(time, decision)

    def _hello(self) -> dict[str, Any]:
        run = self._run
        server = {
            "node": run.node if run else "",
            "service": run.service if run else "",
            "address": run.address if run else "",
            "started": self._begin,
            "speed": run.speed if run else 1.0,
            "version": run.version if run else "",
        }
        shown = None if self._world is None else _map(self._world)
        return {
            "protocol": PROTOCOL,
            "server": server,
            "control": False,
            "now": self._begin,
            "map": shown,
        }

    def _graph(self, calls: Sequence[RecordedCall]) -> Iterator[TimedEvent]:
        """Yield the nodes whenever a new client or a new pair of client and service appears."""
        nodes: dict[str, dict[str, Any]] = {}
        if self._run is not None:
            nodes[self._run.node] = _node(self._run.node, services=self._run.services)
        known: set[tuple[str, str]] = set()
        last = self._begin
        yield TimedEvent(last, "graph", _nodes(nodes))
        is_new = False
        for call in calls:
            if is_new and call.begin - last >= 1.0:
                last, is_new = call.begin, False
                yield TimedEvent(last, "graph", _nodes(nodes))
            if (call.client, call.service) not in known and len(known) < 10 * MAX_NODES:
                known.add((call.client, call.service))
                nodes.setdefault(call.client, _node(call.client))["clients"].append(call.service)
                is_new = True
        if is_new:
            yield TimedEvent(calls[-1].begin, "graph", _nodes(nodes))


class _RobotClock:
    """Converts the time of day to the robot's clock, from pairs of both in the recording."""

    def __init__(self) -> None:
        self.speed = 1.0
        self._pair: tuple[float, float] | None = None

    def note(self, time: float, now: float) -> None:
        self._pair = time, now

    def now(self, time: float) -> float | None:
        if self._pair is None:
            return None
        return self._pair[1] + (time - self._pair[0]) * self.speed


class _Tasks:
    """Makes the `tasks` events."""

    def __init__(self, clock: _RobotClock, period: float) -> None:
        self.begun: int | None = None
        """The task that the robot executes."""
        self._clock = clock
        self._period = period
        self._queue: QueueReplay | None = None
        self._tasks: dict[int, Task] = {}
        self._ended: deque[int] = deque(maxlen=MAX_ENDED)
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

    def change(self, time: float, task: Task) -> None:
        self._changed(time)
        before = self._tasks.get(task.task_id)
        if before is not None and before.state.is_ended:
            self._counts[before.state.value] -= 1
            if task.task_id in self._ended:
                self._ended.remove(task.task_id)
        if task.state.is_ended:
            self._counts[task.state.value] += 1
            self._ended.appendleft(task.task_id)
        self._tasks[task.task_id] = msgspec.structs.replace(task, result="")
        if task.state.is_begun:
            self.begun = task.task_id
        elif self.begun == task.task_id and task.state.is_ended:
            self.begun = None

    def due(self, time: float) -> Iterator[TimedEvent]:
        """Yield the event of earlier changes if its time has come."""
        if self._changed_at is None:
            return
        when = max(self._changed_at + _BURST, self._last + self._period)
        if when <= time:
            yield self._event(when)

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
        is_common = delay.after == BEFORE_RUNNING_KEY and not delay.only_task
        if abs(seconds) < (_MIN_COMMON_MOVE if is_common else _MIN_MOVE):
            return
        self._changed(time)
        for task in waiting:
            concerned = delay.only_task == task.task_id if delay.only_task else True
            if concerned and delay.after < task.order_key:
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
        known = [self._tasks.get(task.task_id, task) for task, _ in rows]
        shown = [
            task_json(msgspec.structs.replace(each, priority=task.priority), ahead + seconds)
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


class _Robot:
    """Makes the `robot` and `path` events."""

    def __init__(self, clock: _RobotClock, period: float) -> None:
        self._clock = clock
        self._period = period
        self._last = float("-inf")
        self._pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self._end: float | None = None  # robot seconds; None while the robot is halted
        self._battery: float | None = None
        self._odometer: float | None = None
        self._class: Any = None

    def start(self, time: float, start: RobotStart) -> Iterator[TimedEvent]:
        standing = start.standing
        yield from self.take(time, RobotStep(method="start", standing=standing), None)

    def take(self, time: float, step: RobotStep, task_id: int | None) -> Iterator[TimedEvent]:
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


def task_json(task: Task, estimated_time: float) -> dict[str, Any]:
    """Return a task as the events contain it."""
    return {
        "task_id": task.task_id,
        "task_type": task.task_type,
        "target": task.target,
        "priority": task.priority,
        "state": task.state.value,
        "client": task.client,
        "estimated_time": round(max(0.0, estimated_time), 3),
        "accepted_estimate": round(task.accepted_estimate, 3),
        "progress": round(task.progress, 4),
        "message": task.message,
        "submitted": task.submitted_at,
        "started": task.started_at,
        "ended": task.ended_at,
    }


def _map(world: WorldFacts) -> dict[str, Any]:
    return {
        "size": world.size,
        "radius": world.radius,
        "dock": world.dock,
        "boxes": [box.corners() for box in world.boxes],
        "places": {**world.places, "dock": world.dock},
    }


def _scan(time: float, task: Task) -> Iterator[TimedEvent]:
    if task.state is not TaskState.SUCCEEDED or '"ranges"' not in task.result:
        return
    try:
        result = msgspec.json.decode(task.result)
        names = ("angle_min", "angle_increment", "range_max", "ranges")
        scan = {name: result[name] for name in names}
        pose = {name: result["pose"][name] for name in ("x", "y", "theta")}
    except (msgspec.MsgspecError, KeyError, TypeError):
        return  # a robot class of the user's own may return anything
    yield TimedEvent(time, "scan", {"task_id": task.task_id, "t": time, **pose, **scan})


def _call_events(calls: Sequence[RecordedCall]) -> Iterator[TimedEvent]:
    """Yield the calls when they end; long and open calls also when they begin."""
    moments: list[tuple[float, int, dict[str, Any], RecordedCall | None]] = []
    for number, call in enumerate(calls[:_MOST_CALLS], 1):
        ended = None if call.ms is None else call.begin + call.ms / 1e3
        if ended is None or ended - call.begin > _SLOW:
            moments.append((call.begin, number, _call(number, call, ended=False), None))
        if ended is not None:
            moments.append((ended, number, _call(number, call, ended=True), call))
    moments.sort(key=lambda moment: moment[:2])
    statistics = _Statistics()
    batch: list[dict[str, Any]] = []
    first = 0.0
    for time, _, shown, ended_call in moments:
        if batch and time - first >= _CALLS_PERIOD:
            yield _calls_event(first + _CALLS_PERIOD, batch, statistics)
            batch = []
        if not batch:
            first = time
        batch.append(shown)
        statistics.take(time, ended_call)
    if batch:
        yield _calls_event(moments[-1][0], batch, statistics)


def _calls_event(time: float, batch: list[dict[str, Any]], statistics: _Statistics) -> TimedEvent:
    skipped = max(0, len(batch) - MAX_CALLS)
    data = {"calls": batch[skipped:], "skipped": skipped, "stats": statistics.at(time)}
    return TimedEvent(time, "calls", data)


def _call(number: int, call: RecordedCall, *, ended: bool) -> dict[str, Any]:
    return {
        "id": number,
        "client": call.client,
        "account": call.account,
        "service": call.service,
        "begin": call.begin,
        "ms": round(call.ms, 3) if ended and call.ms is not None else None,
        "state": call.state if ended else "open",
        "code": call.code if ended else "",
        "deadline_ms": None if call.deadline_ms is None else round(call.deadline_ms, 1),
        "attempt": 1,
        "repeated": False,
        "task_id": call.task_id,
    }


class _Statistics:
    """The statistics of the calls so far."""

    def __init__(self) -> None:
        self._total = self._errors = 0
        self._open: int = 0
        self._durations: deque[float] = deque(maxlen=_SAMPLED)
        self._recent: deque[float] = deque()

    def take(self, time: float, call: RecordedCall | None) -> None:
        """Note a call that ends, or that begins (None)."""
        if call is None:
            self._open += 1
            return
        self._total += 1
        self._errors += bool(call.code)
        self._durations.append(call.ms or 0.0)
        self._recent.append(time)
        if call.ms is not None and call.ms > _SLOW * 1e3:
            self._open -= 1

    def at(self, time: float) -> dict[str, Any]:
        while self._recent and self._recent[0] < time - 1.0:
            self._recent.popleft()
        ordered = sorted(self._durations)
        return {
            "per_second": float(len(self._recent)),
            "p50_ms": _percentile(ordered, 0.5),
            "p99_ms": _percentile(ordered, 0.99),
            "errors": self._errors,
            "total": self._total,
            "open": self._open,
        }


def _percentile(ordered: Sequence[float], share: float) -> float | None:
    if not ordered:
        return None
    return round(ordered[min(len(ordered) - 1, int(share * len(ordered)))], 3)


def _node(name: str, services: Sequence[str] = ()) -> dict[str, Any]:
    lists: dict[str, list[str]] = {"clients": [], "publishers": [], "subscriptions": []}
    return {"name": name, "program": "", "host": "", "services": list(services), **lists}


def _nodes(nodes: dict[str, dict[str, Any]]) -> dict[str, Any]:
    shown = [{**node, "clients": list(node["clients"])} for node in nodes.values()]
    return {"nodes": shown[:MAX_NODES], "more": max(0, len(shown) - MAX_NODES)}
