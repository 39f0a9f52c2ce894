"""Records a whole run of a task server: its calls, its topics, and every decision.

`taskrpc-server --record FILE` uses it: `calls` for the node, `journal` for the task server and
the robot, then `follow` once the server has started. Without `follow`, `close` removes the file.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from importlib.metadata import version
from typing import Any, NamedTuple

import msgspec

import srvgen
from srvgen.cdr.encode import encoder_of
from srvgen.classes.loader import search
from taskrpc import CallInfo, Observer
from taskrpc.errors import Code
from taskrpc.node import Node
from taskrpc.observe.recording.calls import CALLS_TOPIC, CallEnd
from taskrpc.observe.recording.decisions import (
    DECISIONS_TOPIC,
    Decision,
    PauseChange,
    ProgressMade,
    RunStart,
    TaskChange,
)
from taskrpc.observe.recording.mcap_file import RecordingError, RecordingWriter
from taskrpc.observe.recording.recorder import Recorder, Selection
from taskrpc.observe.recording.schemas import EVENT, schema_text
from taskrpc.robot.tasks.model import Task
from taskrpc.robot.tasks.server import TaskServer
from taskrpc.spi import SUFFIX, gid_of, service_event, time_of_day_ns

log = logging.getLogger("taskrpc.recording")

_PROGRESS_PERIOD = 20_000_000
"""Minimum nanoseconds between two lines about the running task's progress."""
_KEPT_GIDS = 4096
"""Clients whose identity is remembered; it is computed again when needed."""


class RunRecorder:
    """Records one run into a new file. If the disk fails, the server continues without recording.

    Args:
        path: the file, which must not exist.
        clock: the time of day, in nanoseconds since 1970.

    Raises:
        RecordingError: the file cannot be created.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, clock: Callable[[], int] = time_of_day_ns
    ) -> None:
        self.clock = clock
        self._writer = RecordingWriter(path)
        self._encode = msgspec.json.Encoder().encode
        self._decisions = self._writer.add_json_topic(DECISIONS_TOPIC)
        self._is_open = True
        self._has_begun = False
        """Whether the server has started."""
        self.calls = CallRecorder(self)
        """The observer: records the calls of the node that gets it."""
        self._recorder: Recorder | None = None
        self._server: TaskServer | None = None
        self._known: dict[int, Task] = {}
        """The last written values of the tasks that have not ended."""
        self._paused = False
        self._progress_at = 0
        """When the progress was last written, in nanoseconds since 1970."""

    @property
    def writer(self) -> RecordingWriter:
        """The file."""
        return self._writer

    def journal(self, decision: Decision) -> None:
        """Write a decision."""
        self.write(self._decisions, self._encode(decision))

    async def follow(self, node: Node, server: TaskServer, *, service: str = "/robot_task") -> None:
        """Record the topics and the tasks of a server that has started."""
        manager, name = server.manager, node.get_fully_qualified_name()
        own = [entry for entry in await node.graph() if entry.pid == os.getpid()]
        services = [each for entry in own for each in entry.services if each.node == name]
        names = tuple(each.name for each in services)
        speed, address = manager.speed, node.address
        self.journal(RunStart(name, service, address, version("taskrpc"), speed, names))
        for each in services:  # now, so that it does not delay the first call
            self.calls.add_service(each.name, each.type_name)
        self._server = server
        for task in list(manager.repository.tasks()):
            self._write_task(task)
        self._paused = manager.is_paused
        self.journal(PauseChange(self._paused))
        manager.change_feed.add_listener(self._changed)
        selection = Selection(topics=[f"{service}/events", f"{service}/pose"])
        self._recorder = Recorder(node, self._writer, selection, self.fail, self.clock)
        self._recorder.update(own)
        self._has_begun = True

    async def close(self) -> None:
        """Write the summary and close the file. If nothing was followed, remove the file."""
        if self._recorder is not None:
            self._recorder.close()
            self._recorder = None
        was_open, self._is_open = self._is_open, False
        if not self._has_begun:
            self._writer.discard()
            return
        try:
            self._writer.close()
        except RecordingError as error:
            if was_open:  # otherwise the log has the error already
                log.error("%s", error)

    def write(self, topic: int, data: bytes) -> None:
        """Write a message with the present time."""
        if self._is_open:
            try:
                self._writer.write(topic, data, self.clock())
            except RecordingError as error:
                self.fail(error)

    def fail(self, error: Exception) -> None:
        """Stop the recording because of an error; the server continues."""
        if self._is_open:
            self._is_open = False
            log.error("the recording ends here: %s", error)

    def _changed(self, task_id: int | None) -> None:
        """Write a change at once, before the server responds: a killed server has recorded it."""
        try:
            self._write_change(task_id)
        except Exception as error:  # the server must not depend on its recording
            self.fail(error)

    def _write_change(self, task_id: int | None) -> None:
        assert self._server is not None, "listens after the start"
        manager = self._server.manager
        if manager.is_paused != self._paused:
            self._paused = manager.is_paused
            self.journal(PauseChange(self._paused))
        task = None if task_id is None else manager.repository.find(task_id)
        if task is not None and task != self._known.get(task.task_id):
            self._write_task(task)

    def _write_task(self, task: Task) -> None:
        before = self._known.get(task.task_id)
        if before is not None and task == _with_progress(before, task.progress):
            now = self.clock()
            if 0 <= now - self._progress_at < _PROGRESS_PERIOD:
                return  # a robot may report its progress thousands of times a second
            self._progress_at = now
            self.journal(ProgressMade(task.task_id, task.progress))
        else:
            self.journal(TaskChange(task))
        self._known[task.task_id] = task
        if task.state.is_ended:
            del self._known[task.task_id]  # a server may run for weeks


def _with_progress(task: Task, progress: float) -> Task:
    return msgspec.structs.replace(task, progress=progress)


class CallRecorder(Observer):
    """Records the calls of a node: their events as rosbag2 does, and a line about each end."""

    def __init__(self, recorder: RunRecorder) -> None:
        self._recorder = recorder
        self._topics: dict[str, _ServiceTopic] = {}
        """The topic of each service, by the service's name."""
        self._ends: int | None = None
        """The number of `CALLS_TOPIC` in the file."""
        self._gids: dict[str, list[int]] = {}
        self._tasks: dict[int, int] = {}
        """The tasks that open calls are about, by the number of the call."""
        self._encode = msgspec.json.Encoder().encode

    def call_began(self, call: CallInfo) -> None:
        """Record the request."""
        request: Any = getattr(call, "request", None)
        if request is None:
            return
        if (task_id := getattr(request, "task_id", 0)) > 0:
            self._tasks[call.number] = task_id
        self._record("REQUEST_RECEIVED", call, request=request)

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """Record the response."""
        if (task_id := getattr(response, "task_id", 0)) > 0:
            self._tasks[call.number] = task_id
        self._record("RESPONSE_SENT", call, response=response)

    def call_ended(self, call: CallInfo, code: Code, seconds: float) -> None:
        """Record the end."""
        if self._ends is None:
            self._ends = self._recorder.writer.add_json_topic(CALLS_TOPIC)
        deadline_ms = None
        if call.deadline is not None:
            deadline_ms = (call.deadline - call.clock() + seconds) * 1e3
        end = CallEnd(
            call.number,
            call.service,
            call.caller,
            self._recorder.clock() / 1e9 - seconds,
            seconds * 1e3,
            code.name,
            call.principal,
            deadline_ms,
            self._tasks.pop(call.number, None),
        )
        self._recorder.write(self._ends, self._encode(end))

    def _record(self, step: str, call: CallInfo, **messages: Any) -> None:
        topic = self._topics.get(call.service)
        if topic is None:
            (message,) = messages.values()
            topic = self.add_service(call.service, message._TYPE.rpartition("_")[0])
        gid = self._gids.get(call.caller)
        if gid is None:
            if len(self._gids) >= _KEPT_GIDS:
                self._gids.clear()
            gid = self._gids[call.caller] = gid_of(call.caller)
        stamp = self._recorder.clock()
        event = service_event(topic.srv_type, step, stamp, gid, call.number, **messages)
        # Without the check of `to_cdr`: the server has received or sent the message.
        self._recorder.write(topic.number, topic.encode(event))

    def add_service(self, service: str, type_name: str) -> _ServiceTopic:
        """Prepare for the calls of a service; returns its topic."""
        known = self._topics.get(service)
        if known is None:
            srv_type: Any = srvgen.load(type_name)
            name, text = f"{type_name}{EVENT}", schema_text(f"{type_name}{EVENT}", search())
            writer, type_hash = self._recorder.writer, srv_type.Event._HASH
            number = writer.add_topic(service + SUFFIX, name, text, type_hash=type_hash)
            known = _ServiceTopic(srv_type, number, encoder_of(srv_type.Event))
            self._topics[service] = known
        return known


class _ServiceTopic(NamedTuple):
    """The topic of a service's events."""

    srv_type: Any
    number: int
    encode: Callable[[Any], bytes]
    """Encodes an event."""
