"""What the live page shows, as events: tasks, robot, path, scan, graph, frames and class.

`LiveTasks` makes the JSON of tasks and robot from a task manager. `Live` runs while pages are open:
ten times a second it looks for changes and publishes them to the stream. All lists are bounded.
"""

from __future__ import annotations

import asyncio
import contextlib
import heapq
import logging
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import metadata
from typing import Any, Protocol

import msgspec

from taskrpc.observe.web.streams import CallsEvent, Event, LiveStream
from taskrpc.observe.web.transforms import MAX_FRAMES
from taskrpc.robot.tasks.managed import ManagedTasks
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.page_events import (
    MAX_ENDED,
    MAX_MOVES,
    MAX_NODES,
    MAX_QUEUE,
    MAX_ROBOTS,
    MIN_MOVE,
    PROTOCOL,
    concerns,
    map_json,
    result_json,
    robot_json,
    scan_json,
    task_json,
)
from taskrpc.robot.tasks.services.pages import Row, page
from taskrpc.robot.world import World

log = logging.getLogger("taskrpc.web")

TICK = 0.1
"""Seconds between two looks for changes."""
PROGRESS_PERIOD = 0.5
"""Minimum seconds between two `tasks` events if only the running task's progress has changed."""
ROBOT_PERIOD = 1.0
"""Maximum seconds between two `robot` events while a task runs."""
CALLS_TICKS = 2
"""Ticks between two `calls` events, and between two `frames` events."""
GRAPH_PERIOD = 1.0
"""Seconds between two looks at the nodes, and at the class."""

_MAX_DELAYS = 200  # new delays that one look considers


def whole_task_json(manager: ManagedTasks, task_id: int) -> bytes | None:
    """Return one task with its result and the changes of its estimate; None if there is none."""
    task = manager.repository.find(task_id)
    if task is None:
        return None
    manager.update_estimates()
    changes = [{"seconds": each.seconds, "cause": each.cause} for each in manager.changes(task)]
    shown = task_json(task, manager.estimate(task_id))
    whole = shown | {"result": result_json(task), "changes": changes}
    return msgspec.json.encode(whole)


class LiveTasks:
    """Makes the events `tasks`, `robot`, `path` and `scan` of a task manager, when they change.

    `now` is an instant on the loop's clock, `wall` the time of day in seconds since 1970.
    """

    def __init__(self, manager: ManagedTasks) -> None:
        self._manager = manager
        self._revision = -1
        """The revision of the last `tasks` event; -1 before the first."""
        self._tasks_at = self._robot_at = -math.inf
        """The instants of the last `tasks` and `robot` events."""
        self._shown: set[int] = set()
        """The running and queued tasks of the last `tasks` event."""
        self._moves: deque[dict[str, Any]] = deque(maxlen=MAX_MOVES)
        """Newest first."""
        newest = manager.delays.since(manager.delays.next_number - 1)
        self._delay = (newest[0].number, newest[0].seconds) if newest else (0, 0.0)
        """The number of the last delay that was considered, and its seconds then."""
        self._ended: list[dict[str, Any]] = []
        self._counts: Counter[str] = Counter()
        self._scan_id = 0
        """The task of the last `scan` event."""
        self._fleet: list[dict[str, Any]] = []
        """The robots of the last `fleet` event; always empty without a fleet."""
        self._robot: tuple[object, ...] = ()
        self._pose: object = None
        self._path: object = None

    def events(self, now: float, wall: float) -> Iterator[Event]:
        """Yield the events for everything that has changed since the last call."""
        yield from self._tasks_event(now, wall)
        yield from self._robot_events(now, wall)
        yield from self._fleet_event()

    def _tasks_event(self, now: float, wall: float) -> Iterator[Event]:
        manager, feed = self._manager, self._manager.change_feed
        rows = page(manager, "", limit=MAX_QUEUE + 1).rows
        moved = self._note_moves([row.task for row in rows], wall)
        if feed.revision == self._revision and not moved:
            return
        changed = feed.changed_since(self._revision)
        if self._is_progress(changed):
            if now - self._tasks_at < PROGRESS_PERIOD:
                return
        else:
            self._update_ended()
            yield from self._scan_event()
        self._revision, self._tasks_at = feed.revision, now
        running = _pop_running(rows, manager.running)
        rows = rows[:MAX_QUEUE]
        self._shown = {row.task.task_id for row in (*rows, *([running] if running else ()))}
        queued = len(manager.queue)
        yield _event(
            "tasks",
            {
                "revision": feed.revision,
                "t": wall,
                "paused": manager.is_paused,
                "queued": queued,
                "running": task_json(running.task, running.estimated_time) if running else None,
                "queue": [
                    task_json(row.task, row.estimated_time, manager.planned_robot(row.task))
                    for row in rows
                ],
                "more": max(0, queued - len(rows)),
                "ended": self._ended,
                "counts": self._counts,
                "moves": list(self._moves),
            },
        )

    def _is_progress(self, changed: Sequence[int] | None) -> bool:
        """Whether only the progress of a running task has changed."""
        if self._revision < 0 or not changed or not self._shown.issuperset(changed):
            return False
        found = (self._manager.repository.find(task_id) for task_id in changed)
        return all(task is not None and task.state is TaskState.RUNNING for task in found)

    def _update_ended(self) -> None:
        ended = list(self._manager.repository.ended())
        newest = heapq.nlargest(MAX_ENDED, ended, key=lambda task: task.ended_at or 0.0)
        self._ended = [task_json(task, 0.0) for task in newest]
        self._counts = Counter(task.state.value for task in ended)

    def _scan_event(self) -> Iterator[Event]:
        for shown in self._ended:
            task = self._manager.repository.find(shown["task_id"])
            if task is None or '"ranges"' not in task.result:
                continue
            if task.task_id != self._scan_id and (scan := scan_json(task)) is not None:
                self._scan_id = task.task_id
                yield _event("scan", scan)
            return

    def _fleet_event(self) -> Iterator[Event]:
        find = self._manager.repository.find
        robots = [robot_json(each, find(each.task_id)) for each in self._manager.robots()]
        if robots != self._fleet:
            self._fleet = robots
            yield _event("fleet", {"robots": robots[:MAX_ROBOTS]})

    def _note_moves(self, tasks: Sequence[Task], wall: float) -> bool:
        """Note which shown tasks will end at another time than before, and why."""
        number, counted = self._delay
        delays = self._manager.delays.since(number)[-_MAX_DELAYS:]
        if not delays:
            return False
        self._delay = delays[-1].number, delays[-1].seconds
        shifts = [
            (delay, delay.seconds - (counted if delay.number == number else 0.0))
            for delay in delays
        ]
        found = []
        for task in tasks:
            if task.task_id in self._shown:  # a newer task has these delays in its estimate
                totals: dict[str, float] = {}
                for delay, seconds in shifts:
                    if concerns(delay, task, seconds):
                        totals[delay.cause] = totals.get(delay.cause, 0.0) + seconds
                found += [
                    {"task_id": task.task_id, "seconds": round(sum_, 3), "cause": cause, "t": wall}
                    for cause, sum_ in totals.items()
                    if abs(sum_) >= MIN_MOVE
                ]
        self._moves.extendleft(reversed(found[:MAX_MOVES]))
        return bool(found)

    def _robot_events(self, now: float, wall: float) -> Iterator[Event]:
        manager = self._manager
        telemetry, running = manager.telemetry(), manager.running
        pose = telemetry.pose
        moving, self._pose = self._pose not in (None, pose), pose
        battery = None if telemetry.battery is None else round(telemetry.battery, 1)
        odometer = None if telemetry.odometer is None else round(telemetry.odometer, 2)
        robot = (pose, moving, battery, odometer, running is None)
        is_due = running is not None and now - self._robot_at >= ROBOT_PERIOD
        if robot != self._robot or is_due:
            self._robot, self._robot_at = robot, now
            yield _event(
                "robot",
                {
                    "t": wall,
                    "x": round(pose.x, 4),
                    "y": round(pose.y, 4),
                    "theta": round(pose.theta, 4),
                    "moving": moving,
                    "remaining": round(manager.remaining(), 3),
                    "battery": battery,
                    "odometer": odometer,
                },
            )
        path = (None if running is None else running.task_id, telemetry.path if running else ())
        if path != self._path:
            self._path = path
            yield _event("path", {"task_id": path[0], "points": path[1]})


def _pop_running(rows: list[Row], running: Task | None) -> Row | None:
    """Remove the row of this server's running task; in a fleet, other robots run tasks too."""
    for index, row in enumerate(rows):
        if row.task.state is TaskState.QUEUED:
            return None
        if running is not None and row.task.task_id == running.task_id:
            return rows.pop(index)
    return None


class LiveCalls(Protocol):
    """The calls that the page shows; see `taskrpc.observe.web.calls.CallLog`."""

    is_active: bool
    """Whether pages are open, so that details of calls are kept."""

    def event(self, now: float, *, always: bool = False) -> CallsEvent | None:
        """Return the calls since the last event, None if nothing has changed; not with `always`."""


class LiveGraph(Protocol):
    """The nodes that the page shows; see `taskrpc.observe.web.graph.NodeGraph`."""

    async def look(self) -> list[dict[str, Any]]:
        """Return all nodes as JSON values."""

    def frames(self) -> list[dict[str, Any]]:
        """Return the frames of `/tf` and `/tf_static` as JSON values."""

    def close(self) -> None:
        """Stop watching the calls and the transforms of other programs."""


class Live:
    """Publishes what the live page shows, while pages are open.

    Args:
        manager: the tasks and the robot.
        stream: sends the events to the pages.
        about: what `hello` says about the server, besides the robot's speed and the version.
        calls, graph: the calls and the nodes; without them, the page shows none.
        students: returns the students of a class as JSON values, None without a class.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        manager: ManagedTasks,
        stream: LiveStream,
        about: Callable[[], Mapping[str, object]],
        *,
        calls: LiveCalls | None = None,
        graph: LiveGraph | None = None,
        students: Callable[[], list[dict[str, Any]]] | None = None,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self._manager = manager
        self._stream = stream
        self._about = about
        self._calls = calls
        self._graph = graph
        self._students = students
        self._wall_clock = wall_clock
        self._tasks: LiveTasks | None = None
        """Made when the first page opens."""
        self._running: list[asyncio.Task[None]] = []
        self._seen: dict[str, bytes] = {}
        """The last `graph`, `class` and `frames` events."""
        self._ticks = 0
        self._problem = ""
        """The last logged exception."""
        stream.source = self

    def hello(self, *, control: bool) -> bytes:
        """Return the first event of a page as text; `control`: whether it may change tasks."""
        server = {
            **self._about(),
            "speed": float(self._manager.robot.speed),
            "version": metadata.version("taskrpc"),
        }
        world = getattr(self._manager.robot, "world", None)
        return _event(
            "hello",
            {
                "protocol": PROTOCOL,
                "server": server,
                "control": control,
                "now": self._wall_clock(),
                "map": map_json(world) if isinstance(world, World) else None,
            },
        ).text

    def task(self, task_id: int) -> bytes | None:
        """Return one task with its result and changes as JSON, None if there is none."""
        return whole_task_json(self._manager, task_id)

    def begin(self) -> None:
        """Publish all states now, and their changes from now on."""
        self._tasks = LiveTasks(self._manager)
        self._seen.clear()
        self._ticks = 0
        if self._calls is not None:
            self._calls.is_active = True
        self._publish()
        self._running = [asyncio.create_task(self._publish_changes(), name="taskrpc live page")]
        if self._graph is not None or self._students is not None:
            self._running.append(asyncio.create_task(self._publish_nodes(), name="taskrpc graph"))

    def end(self) -> None:
        """Stop publishing."""
        for task in self._running:
            task.cancel()
        self._running.clear()
        if self._calls is not None:
            self._calls.is_active = False
        if self._graph is not None:
            self._graph.close()

    async def _publish_changes(self) -> None:
        while True:
            await asyncio.sleep(TICK)
            self._publish()

    def _publish(self) -> None:
        with self._logged("tasks"):
            self._publish_tasks()

    def _publish_tasks(self) -> None:
        assert self._tasks is not None, "published before the first page"
        now = asyncio.get_running_loop().time()
        events: list[Event | CallsEvent] = [*self._tasks.events(now, self._wall_clock())]
        self._ticks += 1
        if self._calls is not None and self._ticks % CALLS_TICKS == 1:
            calls = self._calls.event(now, always=self._ticks == 1)
            events += [] if calls is None else [calls]
        self._stream.publish(events)
        if self._graph is not None and self._ticks % CALLS_TICKS == 1:
            frames = self._graph.frames()
            if frames or "frames" in self._seen:
                self._publish_list("frames", "frames", frames, MAX_FRAMES)

    async def _publish_nodes(self) -> None:
        while True:
            with self._logged("nodes"):
                if self._graph is not None:
                    nodes = await self._graph.look()
                    self._publish_list("graph", "nodes", nodes, MAX_NODES)
                if self._students is not None:
                    self._publish_list("class", "students", self._students(), 2 * MAX_NODES)
            await asyncio.sleep(GRAPH_PERIOD)

    @contextlib.contextmanager
    def _logged(self, what: str) -> Iterator[None]:
        """Log an exception once: a part that cannot be shown must not stop the other parts."""
        try:
            yield
        except Exception as error:
            problem = f"{what}: {error!r}"
            if problem != self._problem:
                self._problem = problem
                log.exception("the live page cannot show the %s", what)

    def _publish_list(self, name: str, key: str, items: list[dict[str, Any]], most: int) -> None:
        json = msgspec.json.encode({key: items[:most], "more": max(0, len(items) - most)})
        if json != self._seen.get(name):
            self._seen[name] = json
            self._stream.publish([Event(name, json)])


def _event(name: str, value: Mapping[str, Any]) -> Event:
    return Event(name, msgspec.json.encode(value))
