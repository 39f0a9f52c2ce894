"""A recording as the live page's events: the same JSON as the event stream, each with its time.

The events `tasks`, `robot`, `path`, `scan` and `graph` are whole states: at any time, the newest of
each name is what the page shows. The events `calls`, `task` and `note` add up. Long recordings are
thinned out, so that a browser can keep all events in memory. Here they are compressed.
"""

from __future__ import annotations

import contextlib
import heapq
import math
from collections.abc import Iterator
from typing import Any

import msgspec

import srvgen
from taskrpc.observe.recording.call_events import PERIOD, call_events, graph_events
from taskrpc.observe.recording.calls import CallReader, RecordedCall, is_about_calls
from taskrpc.observe.recording.compressed_lines import CompressedLines
from taskrpc.observe.recording.decisions import (
    DECISIONS_TOPIC,
    Decision,
    PauseChange,
    ProgressMade,
    RunStart,
    TaskChange,
    decision_of,
)
from taskrpc.observe.recording.mcap_file import Recording, RecordingError, Topic
from taskrpc.observe.recording.state_events import RobotClock, RobotEvents, TaskEvents
from taskrpc.observe.recording.timed_event import NOTES_TOPIC, Note, TimedEvent, note_events
from taskrpc.robot.journal import RobotStart, RobotStep, WorldFacts
from taskrpc.robot.tasks.page_events import PROTOCOL, map_json
from taskrpc.robot.tasks.queue.journal import QueueStart, QueueStep

_POSE = "geometry_msgs/msg/PoseStamped"
_NEVER = -math.inf
_ADDING_UP = ("calls", "task", "note")
"""The events that are no whole states."""


class Timeline:
    """All events of a recording, in the order of time; iterate over it to get them.

    Args:
        recording: the file; recordings without decisions have only `hello`, `calls`, `graph` and
            `note`.
        mistake: another problem of the recording, as a sentence.

    Raises:
        RecordingError: the recording cannot be read, or has no message.
    """

    def __init__(self, recording: Recording, *, mistake: str = "") -> None:
        self.recording = recording
        overview = _Overview(recording)
        self.begin, self.end = overview.begin, overview.end
        """Seconds since 1970 of the first and the last message."""
        states = _States(overview)
        self._lines = CompressedLines()
        encode = msgspec.json.Encoder().encode
        for event in heapq.merge(
            states.events(recording),
            call_events(overview.calls, period=0.0 if overview.notes else PERIOD),
            graph_events(self.begin, self.end, overview.run, overview.calls),
            note_events(overview.notes),
            key=lambda event: event.t,
        ):
            self._lines.add(event.t, encode(event))
        self._lines.flush()
        # The folder `.` has no name.
        self.name = recording.path.name or recording.path.resolve().name
        """The name of the file or the folder."""
        problems = [each for each in (recording.problem, states.problem, mistake) if each]
        if states.decisions == 0 and not overview.notes:
            problems.append(
                f"{self.name} has no decisions of a task server, so there is no map and"
                " no queue; the page shows the calls and the nodes"
            )
        self.problem = "; ".join(problems)
        """What is missing, as a sentence; "" if nothing is."""
        self.hello = TimedEvent(self.begin, "hello", self._hello(overview, states))
        """The first event: the server, the map, and the span of the recording."""

    def __iter__(self) -> Iterator[TimedEvent]:
        yield self.hello
        yield from self._decoded(_NEVER)

    def events_between(self, begin: float, end: float) -> Iterator[TimedEvent]:
        """Iterate over the events from `begin` to before `end`, in seconds since 1970."""
        if begin <= self.hello.t < end:
            yield self.hello
        for event in self._decoded(begin):
            if event.t >= end:
                return
            if event.t >= begin:
                yield event

    def state_at(self, time: float) -> dict[str, TimedEvent]:
        """Return what the page shows at a time: the newest event of each state, by its name."""
        newest = {event.event: event for event in self.events_between(self.begin, time)}
        for name in _ADDING_UP:
            newest.pop(name, None)
        return newest

    def lines(self) -> Iterator[bytes]:
        """Iterate over the events without `hello` as parts of a text: each event is a line of JSON.

        A line is `{"t":…,"event":…,"data":{…}}`.
        """
        return self._lines.blocks()

    def gzipped(self) -> Iterator[bytes]:
        """Iterate over the same text as parts of one gzip stream."""
        return self._lines.gzipped()

    @property
    def compressed_size(self) -> int:
        """Bytes that the events take in memory."""
        return self._lines.compressed_size

    def _decoded(self, begin: float) -> Iterator[TimedEvent]:
        decode = msgspec.json.Decoder(TimedEvent).decode
        for block in self._lines.blocks(begin):
            yield from map(decode, block.splitlines())

    def _hello(self, overview: _Overview, states: _States) -> dict[str, Any]:
        run = overview.run
        server = {
            "node": run.node if run else "",
            "service": run.service if run else "",
            "address": run.address if run else "",
            "started": self.begin,
            "speed": run.speed if run else 1.0,
            "version": run.version if run else "",
        }
        span = {"name": self.name, "begin": self.begin, "end": self.end}
        return {
            "protocol": PROTOCOL,
            "server": server,
            "control": False,
            "now": self.begin,
            "map": None if states.world is None else map_json(states.world.world()),
            "recording": {**span, "problem": self.problem},
        }


class _Overview:
    """What must be known before the events are made; from a first pass over the messages."""

    def __init__(self, recording: Recording) -> None:
        self.run: RunStart | None = None
        self.notes: list[tuple[float, Note]] = []
        """The notes of a simulation, with their times in seconds since 1970."""
        first, last = 0, 0
        reader = CallReader(texts=False)
        for message in recording.messages():
            first = min(first or message.time, message.time)
            last = max(last, message.time)
            if is_about_calls(message.topic):
                reader.take(message)
            elif message.topic.name == DECISIONS_TOPIC and self.run is None:
                self._take(message.data)
            elif message.topic.name == NOTES_TOPIC:
                with contextlib.suppress(msgspec.MsgspecError, UnicodeDecodeError):  # damaged
                    note = msgspec.json.decode(message.data, type=Note)
                    self.notes.append((message.time / 1e9, note))
        if not last:
            rest = f": {recording.problem}" if recording.problem else ""
            raise RecordingError(f"{recording.path} has no message{rest}")
        self.begin, self.end = first / 1e9, last / 1e9
        self.calls: list[RecordedCall] = sorted(reader.calls, key=lambda call: call.begin)

    def _take(self, data: bytes) -> None:
        try:
            self.run = msgspec.json.decode(data, type=RunStart)
        except (msgspec.MsgspecError, UnicodeDecodeError):
            return  # another decision


class _States:
    """Makes the events of the decisions and the poses, from a second pass over the messages."""

    def __init__(self, overview: _Overview) -> None:
        self.world: WorldFacts | None = None
        self.decisions = 0
        """How many decisions there are."""
        self.problem = ""
        self._time, self._end = overview.begin, overview.end
        span = self._end - self._time
        self._pose_topic = f"{overview.run.service}/pose" if overview.run else ""
        self._clock = RobotClock()
        self._tasks = TaskEvents(self._clock, span)
        self._robot = RobotEvents(self._clock, span)

    def events(self, recording: Recording) -> Iterator[TimedEvent]:
        """Yield the events; the times never go back, as the time of day may."""
        for message in recording.messages(keep=self._is_state):
            self._time = max(self._time, message.time / 1e9)
            yield from self._tasks.due(self._time)
            try:
                if message.topic.name != DECISIONS_TOPIC:
                    yield from self._robot.take_pose(self._time, message)
                elif not self.problem:
                    self.decisions += 1
                    yield from self._take(self._time, decision_of(message))
            except (RecordingError, srvgen.CdrError) as error:
                what = f"decision {self.decisions} and those after it"
                self.problem = self.problem or f"{what} cannot be shown: {error}"
        yield from self._tasks.finish(self._end)

    def _take(self, time: float, decision: Decision) -> Iterator[TimedEvent]:
        match decision:
            case RunStart():
                self._clock.speed = decision.speed
            case RobotStart():
                self.world = decision.world
                yield from self._robot.start(time, decision)
            case RobotStep():
                yield from self._robot.take(time, decision, self._tasks.begun)
            case TaskChange():
                yield from self._tasks.change(time, decision.task)
            case QueueStart() | QueueStep() | ProgressMade() | PauseChange():
                self._tasks.take(time, decision)

    def _is_state(self, topic: Topic) -> bool:
        is_pose = topic.name == self._pose_topic and topic.type_name == _POSE
        return is_pose or topic.name == DECISIONS_TOPIC
