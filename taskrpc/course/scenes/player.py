"""Plays a scene: runs its program in a child process, and reports what happens.

The program really runs; nothing that is reported is written down anywhere. A program that waits for
ever is ended: with `like_ros`, it ignores SIGTERM as in ROS 2, so it is killed.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from taskrpc import Observer
from taskrpc.course.scenes import moments
from taskrpc.course.scenes.moments import Moment
from taskrpc.course.scenes.scene import Excerpt, Scene
from taskrpc.course.scenes.stage import Report, Stage, open_stage
from taskrpc.errors import TaskRpcError
from taskrpc.ros.process_tree import ProcessTree

PROGRAMS = Path(__file__).parent / "programs"
"""The folder of the programs: `NAME/problem.py` and `NAME/cure.py`. A scene that is simulated has a
`NAME/scene.sim.py`, too, in which the program is `shop.py`."""

_START = 30.0
"""Seconds until the first thing happens; a slow computer imports slowly."""
_END = 30.0
"""Seconds after the first thing until a program ends that does not wait for ever."""
_PATIENCE_LIKE_ROS = 3.5
"""Seconds after the first thing until a program that waits for ever is ended."""
_PATIENCE = 10.0
"""The same without `like_ros`: taskrpc needs some seconds until it explains the wait."""
_RUNS = 200
"""Runs of the simulator; the mistake shows within the first twenty."""
_REST = 3.0
"""Seconds that the robot gets at the end to execute its tasks."""


def program_path(scene: Scene, *, cure: bool) -> Path:
    """Return the file of the program with the mistake, or of the corrected one."""
    return PROGRAMS / scene.name / ("cure.py" if cure else "problem.py")


def excerpt(scene: Scene, *, cure: bool) -> Excerpt:
    """Return which lines of this program are shown."""
    return scene.cured if cure else scene.problem


async def play(
    scene: Scene,
    report: Callable[[Moment], None],
    *,
    cure: bool = False,
    like_ros: bool = False,
    observer: Observer | None = None,
) -> None:
    """Run a program of a scene.

    Raises TaskRpcError if the computer is too busy.

    Args:
        scene: the scene.
        report: gets each thing when it happens.
        cure: run the corrected program.
        like_ros: behave exactly like ROS 2.
        observer: gets the calls of the robot, too.
    """
    clock = SceneClock(report)
    async with open_stage(scene, clock.report, observer) as stage:
        await run_on(stage, scene, clock, cure=cure, like_ros=like_ros)


async def run_on(
    stage: Stage, scene: Scene, clock: SceneClock, *, cure: bool, like_ros: bool
) -> None:
    """Run a program of a scene on a stage that is open."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8"}
    environment.pop("TASKRPC_LIKE_ROS", None)
    options = ["--like-ros"] if like_ros else []
    command = [sys.executable, "-m", "taskrpc", "run", *options]
    # A copy: taskrpc takes programs in its own folder for a part of itself, and explains nothing.
    program = Path(shutil.copy(program_path(scene, cure=cure), stage.folder))
    command.append(program.name)
    lines = Lines(clock.report)
    tree = await ProcessTree.start(command, lines.feed, cwd=str(stage.folder), env=environment)
    ended = asyncio.ensure_future(tree.wait())
    try:
        if cure or not scene.will_hang(like_ros=like_ros):
            patience = None
        else:
            patience = _PATIENCE_LIKE_ROS if like_ros else _PATIENCE
        await _until_ended(ended, clock, patience)
    finally:
        if not ended.done():
            tree.kill()
        await asyncio.wait([ended])
        await tree.end_descendants()
    lines.end()
    await stage.rest(_REST)
    if scene.simulated and not like_ros:
        shutil.copy(program, stage.folder / "shop.py")
        for each in await _simulated(PROGRAMS / scene.name, stage.folder, environment):
            clock.report(*each)


async def _simulated(
    scene: Path, folder: Path, environment: dict[str, str]
) -> list[tuple[str, str]]:
    """Run the program again and again in the simulator; returns what that has found.

    Raises TaskRpcError if the simulator cannot run it.
    """
    scenario = Path(shutil.copy(scene / "scene.sim.py", folder))
    command = [sys.executable, "-m", "taskrpc", "simulate", scenario.name]
    command += ["--runs", str(_RUNS), "--jobs", "1", "--json"]
    output = {1: b"", 2: b""}

    def add(stream: int, data: bytes) -> None:
        output[stream] += data

    tree = await ProcessTree.start(command, add, cwd=str(folder), env=environment)
    await tree.wait()
    await tree.end_descendants()
    try:
        return moments.of_simulation(output[1], _RUNS)
    except msgspec.MsgspecError:
        raise TaskRpcError(output[2].decode(errors="replace").strip()) from None


async def _until_ended(
    ended: asyncio.Future[int], clock: SceneClock, patience: float | None
) -> None:
    """Wait for the end of a program.

    `patience`: seconds for a program that waits for ever, None for one that ends. Raises
    TaskRpcError if a program does not begin, or does not end.
    """
    await _first(ended, clock.begun, _START)
    if clock.begun.is_set() and patience is None:
        await asyncio.wait([ended], timeout=_END)
    elif clock.begun.is_set():
        await _first(ended, clock.explained, patience)
    if ended.done():
        return
    if patience is None or not clock.begun.is_set():
        raise TaskRpcError(
            "the program of the scene did not end: the computer is too busy; try again"
        )
    clock.report(*moments.of_hang(clock.now()))


async def _first(ended: asyncio.Future[int], event: asyncio.Event, timeout: float | None) -> None:
    """Wait for the end of a program, or for an event, or for a timeout."""
    happened = asyncio.ensure_future(event.wait())
    first: list[asyncio.Future[Any]] = [ended, happened]
    try:
        await asyncio.wait(first, timeout=timeout, return_when=asyncio.FIRST_COMPLETED)
    finally:
        happened.cancel()


class SceneClock:
    """Turns what happens into moments, whose time counts from the first one."""

    def __init__(self, report: Callable[[Moment], None]) -> None:
        self._report = report
        self._first = 0.0
        self.begun = asyncio.Event()
        """Set when the first thing has happened."""
        self.explained = asyncio.Event()
        """Set when taskrpc has explained something."""

    def now(self) -> float:
        """Return the seconds since the first thing."""
        return asyncio.get_running_loop().time() - self._first

    def report(self, actor: str, text: str) -> None:
        """Report a thing that happens now."""
        if not self.begun.is_set():
            self._first = asyncio.get_running_loop().time()
            self.begun.set()
        self._report(Moment(self.now(), actor, text))
        if actor == moments.TASKRPC:
            self.explained.set()


class Lines:
    """Reports the output of a program line by line."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._rest = {1: b"", 2: b""}
        """The beginning of a line, for each stream."""

    def feed(self, stream: int, data: bytes) -> None:
        """Take some output of a stream, 1 or 2."""
        *lines, self._rest[stream] = (self._rest[stream] + data).split(b"\n")
        for line in lines:
            self._say(line)

    def end(self) -> None:
        """The program has ended."""
        for line in self._rest.values():
            self._say(line)

    def _say(self, line: bytes) -> None:
        found = moments.of_output(line.decode(errors="replace"))
        if found is not None:
            self._report(*found)
