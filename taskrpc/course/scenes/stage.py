"""Where a scene is played: a private discovery folder, and a robot that reports its calls."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

from taskrpc import CallInfo, Observer, Observers
from taskrpc.course.scenes import moments
from taskrpc.course.scenes.scene import Scene
from taskrpc.node import Node
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks import MemoryStore, TaskServer
from taskrpc.testing import CallFaults

Report = Callable[[str, str], None]
"""Gets the actor and the text of each thing that happens; see `moments`."""

SERVICE = "/robot_task"
_SPEED = 10.0
"""Robot seconds per second: a report takes less than a second."""
_SETTLE = 0.2
_LOGGERS = ("taskrpc.server", "taskrpc.tasks")
_FOLDERS = ("XDG_RUNTIME_DIR", "XDG_STATE_HOME", "LOCALAPPDATA")
_POLL = 0.05


@contextlib.asynccontextmanager
async def open_stage(
    scene: Scene, report: Report, observer: Observer | None = None
) -> AsyncIterator[Stage]:
    """Set the stage for one program of a scene.

    It changes the process's environment while it is open: a process plays one scene at a time.
    """
    with private_folders() as folder:
        if not scene.robot:
            yield Stage(folder, None)
            return
        faults = CallFaults(*scene.faults, service=SERVICE) if scene.faults else None
        reports = CallReports(report)
        both = reports if observer is None else Observers(reports, observer)
        node = Node("task_server", observer=both, faults=faults)
        robot = KinematicRobot(default_world(), speed=_SPEED)
        with reported_log(report):
            async with node, TaskServer(node, robot, MemoryStore(), settle=_SETTLE) as server:
                yield Stage(folder, server)


class Stage:
    """The stage of one program; `open_stage` makes it."""

    def __init__(self, folder: Path, server: TaskServer | None) -> None:
        self.folder = folder
        """An empty folder for the program."""
        self._server = server

    async def rest(self, timeout: float) -> None:
        """Wait until the robot has executed all tasks; at most `timeout` seconds."""
        if self._server is None:
            return
        manager = self._server.manager
        idle = 0
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while idle < 2:  # between two tasks, the robot seems idle for an instant
                    is_idle = manager.running is None and not len(manager.queue)
                    idle = idle + 1 if is_idle else 0
                    await asyncio.sleep(_POLL)


class CallReports(Observer):
    """Reports the calls of the robot's service."""

    def __init__(self, report: Report) -> None:
        self._report = report

    def call_began(self, call: CallInfo) -> None:
        """Report a request."""
        if call.service == SERVICE:
            self._report(*moments.of_request(call.number))

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """Report a response."""
        if call.service == SERVICE:
            self._report(*moments.of_response(call.number, repeated=call.repeated))


class _LogReports(logging.Handler):
    """Reports what the log of the robot says about faults and tasks."""

    def __init__(self, report: Report) -> None:
        super().__init__(logging.INFO)
        self._report = report

    def emit(self, record: logging.LogRecord) -> None:
        found = moments.of_log(record.getMessage())
        if found is not None:
            self._report(*found)


@contextlib.contextmanager
def reported_log(report: Report) -> Iterator[None]:
    """Report the robot's log instead of printing it."""
    handler = _LogReports(report)
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    before = [(each.level, each.propagate) for each in loggers]
    for each in loggers:
        each.addHandler(handler)
        each.setLevel(logging.INFO)
        each.propagate = False
    try:
        yield
    finally:
        for each, (level, propagate) in zip(loggers, before, strict=True):
            each.removeHandler(handler)
            each.setLevel(level)
            each.propagate = propagate


@contextlib.contextmanager
def private_folders() -> Iterator[Path]:
    """Hide this machine's servers, and a joined lab, from this process and those that it starts.

    Yields a new folder that is empty.
    """
    before = dict(os.environ)
    with tempfile.TemporaryDirectory(
        prefix="taskrpc-scene-", ignore_cleanup_errors=True
    ) as scratch:
        try:
            os.environ.update(dict.fromkeys(_FOLDERS, scratch))
            os.environ.pop("TASKRPC_PEERS", None)
            folder = Path(scratch, "program")
            folder.mkdir()
            yield folder
        finally:
            for name in (*_FOLDERS, "TASKRPC_PEERS"):
                os.environ.pop(name, None)
                if name in before:
                    os.environ[name] = before[name]
