"""Records a whole run of a task server: its calls, its topics, and every decision.

`taskrpc-server --record FILE` uses it: `calls` for the node, `journal` for the task server and
the robot, then `follow` once the server has started.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any, NamedTuple

import msgspec

import srvgen
from srvgen.cdr.encode import encoder_of
from srvgen.classes.loader import search
from taskrpc.callinfo import CallInfo
from taskrpc.errors import Code
from taskrpc.introspection import SUFFIX, gid_of, service_event
from taskrpc.node import Node
from taskrpc.observer import Observer
from taskrpc.recording.calls import CALLS_TOPIC, CallEnd
from taskrpc.recording.decisions import (
    DECISIONS_TOPIC,
    Decision,
    PauseChange,
    ProgressMade,
    RunStart,
    TaskChange,
)
from taskrpc.recording.mcap_file import RecordingError, RecordingWriter
from taskrpc.recording.recorder import Recorder, Selection
from taskrpc.recording.schemas import EVENT, schema_text
from taskrpc.tasks.model import Task
from taskrpc.tasks.server import TaskServer

log = logging.getLogger("taskrpc.recording")

_PERIOD = 0.02
"""Minimum seconds between two looks at changed tasks."""
_NO_TIMEOUT = 86_400.0
_KEPT_GIDS = 4096
"""Clients whose identity is remembered; it is computed again when needed."""


class RunRecorder:
    """Records one run into a new file. If the disk refuses it, the server runs on without it.

    Args:
        path: the file, which must not exist.
        clock: the time of day, in nanoseconds since 1970.

    Raises:
        RecordingError: the file cannot be created.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, clock: Callable[[], int] = time.time_ns
    ) -> None:
        self.clock = clock
        self._writer = RecordingWriter(path)
        self._encode = msgspec.json.Encoder().encode
        self._decisions = self._writer.add_json_topic(DECISIONS_TOPIC)
        self._is_open = True
        self.calls = CallRecorder(self)
        """The observer: records the calls of the node that gets it."""
        self._recorder: Recorder | None = None
        self._watcher: asyncio.Task[None] | None = None

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
        for task in list(manager.repository.tasks()):
            self.journal(TaskChange(task))
        self.journal(PauseChange(manager.is_paused))
        selection = Selection(topics=[f"{service}/events", f"{service}/pose"])
        self._recorder = Recorder(node, self._writer, selection, self.fail, self.clock)
        self._recorder.update(own)
        self._watcher = asyncio.get_running_loop().create_task(self._watch(server))

    async def close(self) -> None:
        """Write the last changes and the summary, and close the file."""
        if self._watcher is not None:
            self._watcher.cancel()
            await asyncio.wait((self._watcher,))
        if self._recorder is not None:
            self._recorder.close()
        self._is_open = False
        try:
            self._writer.close()
        except RecordingError as error:
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

    async def _watch(self, server: TaskServer) -> None:
        """Write every changed task."""
        manager, known = server.manager, dict[int, Task]()
        feed = manager.change_feed
        revision, paused = feed.revision, manager.is_paused
        try:
            while not feed.is_closed:
                await feed.wait_for_change(revision, _NO_TIMEOUT)
                changed, revision = feed.changed_since(revision), feed.revision
                self._write_changes(server, changed, known)
                if manager.is_paused != paused:
                    paused = manager.is_paused
                    self.journal(PauseChange(paused))
                await asyncio.sleep(_PERIOD)
        finally:  # the end of the running task comes after the feed is closed
            self._write_changes(server, feed.changed_since(revision), known)

    def _write_changes(
        self, server: TaskServer, changed: list[int] | None, known: dict[int, Task]
    ) -> None:
        repository = server.manager.repository
        if changed is None:
            changed = [task.task_id for task in repository.tasks()]
        for task_id in changed:
            task = repository.find(task_id)
            if task is None or task == known.get(task_id):
                continue
            before = known.get(task_id)
            known[task_id] = task
            if before is not None and task == _with_progress(before, task.progress):
                self.journal(ProgressMade(task_id, task.progress))
            else:
                self.journal(TaskChange(task))
            if task.state.is_ended:
                del known[task_id]  # a server may run for weeks


def _with_progress(task: Task, progress: float) -> Task:
    return msgspec.structs.replace(task, progress=progress)


class CallRecorder(Observer):
    """Records the calls of a node: their events as rosbag2 does, and a line about each end."""

    def __init__(self, recorder: RunRecorder) -> None:
        self._recorder = recorder
        self._topics: dict[str, _ServiceTopic] = {}
        """The topic of each service, by the service's name."""
        self._ends: int | None = None
        """The topic's number of the ends of calls."""
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
