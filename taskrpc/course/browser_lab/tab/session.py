"""Does what the page asks for: it starts and stops programs, checks them, and moves the robot."""

from __future__ import annotations

import asyncio
import importlib
import json
import shlex
import sys
from collections.abc import Callable, Mapping
from pathlib import PurePosixPath
from typing import Any

from taskrpc.course.browser_lab.tab.delays import Delays
from taskrpc.course.browser_lab.tab.programs import FOLDER, Programs
from taskrpc.course.browser_lab.tab.robot import TabRobot
from taskrpc.course.browser_lab.tab.threads import Scheduler
from taskrpc.course.browser_lab.tab.trial import trials
from taskrpc.course.labs import catalogue
from taskrpc.course.labs.grading import findings
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import TaskRpcError
from taskrpc.spi import TRANSPORTS, current_program

_IMPORTED = tuple(f"taskrpc.ros.packages.rclpy{each}" for each in ("", ".executors", ".node"))
"""What nearly every program imports; importing it in advance saves each first run seconds."""


class Session:
    """One life of the worker; `ask` receives the requests of the page.

    Args:
        scheduler: the threads of the tab.
        post: sends a text to the page.
    """

    def __init__(self, scheduler: Scheduler, post: Callable[[str], object]) -> None:
        self._post = post
        self._loop = scheduler.loop
        self._programs = Programs(scheduler, self.emit)
        self._robot: TabRobot | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    def emit(self, event: str, **values: Any) -> None:
        """Send an event to the page."""
        self._post(json.dumps({"event": event, **values}))

    def open(self) -> None:
        """Prepare the tab for programs."""
        # All programs of the tab are in one interpreter; there are no sockets.
        TRANSPORTS["tcp"] = TRANSPORTS["memory"]
        FOLDER.mkdir(exist_ok=True)
        sys.path.insert(0, str(FOLDER))
        self._programs.install()
        for module in _IMPORTED:
            importlib.import_module(module)
        self.emit("ready", can_wait=self._programs.scheduler.can_wait)

    def ask(self, text: str) -> None:
        """Do what a request of the page says, and report its errors."""
        request = json.loads(text)
        act = getattr(self, f"_do_{request.pop('do')}")
        task = self._loop.create_task(self._reported(act, request))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _reported(self, act: Callable[..., Any], values: Mapping[str, Any]) -> None:
        try:
            await act(**values)
        except TaskRpcError as error:
            self.emit("problem", text=str(error))
        except Exception as error:  # our own mistake: it must not stay unseen
            self.emit("problem", text=f"{error!r} in {act.__name__}")

    async def _do_start(self, files: Mapping[str, str], programs: Mapping[str, str]) -> None:
        _write(files)
        for file, arguments in programs.items():
            self._programs.start(file, *shlex.split(arguments))

    async def _do_check(self, files: Mapping[str, str], lab: int, variant: str) -> None:
        _write(files)
        passed, total = 0, 0
        new_trial = trials(self._programs, Variant(variant))
        delays = Delays()
        watching = self._loop.create_task(delays.watch())
        try:
            async for finding in findings(catalogue.lab(lab), new_trial, delays.were_long):
                problem = finding.problem
                self.emit(
                    "finding",
                    index=total,
                    title=finding.check.title,
                    passed=finding.passed,
                    waits_for=finding.waits_for,
                    expected=problem.expected if problem else "",
                    happened=problem.happened if problem else "",
                    look=problem.look if problem else "",
                )
                total += 1
                passed += finding.passed
        finally:
            watching.cancel()
        self.emit("checked", passed=passed, total=total)

    async def _do_stop(self, programs: list[str]) -> None:
        running = [self._programs.by_name[name] for name in programs]
        await asyncio.gather(*(program.stop() for program in running))
        self.emit("stopped", programs=programs)

    async def _do_robot(self) -> None:
        current_program.set("robot")
        self._robot = TabRobot(self.emit)
        async with self._robot.running():
            await self._loop.create_future()  # as long as the worker lives

    async def _do_move(self, x: float, y: float) -> None:
        if self._robot is not None:
            self.emit("moving", text=await self._robot.move(x, y))


def _write(files: Mapping[str, str]) -> None:
    for name, text in files.items():
        path = FOLDER / PurePosixPath(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
