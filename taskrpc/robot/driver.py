"""The simulated robot: drives a `Course` in real time, on the event loop's clock."""

import asyncio
import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import msgspec

from taskrpc.robot.course import Course, Standing
from taskrpc.robot.journal import JournaledCourse, RobotJournal
from taskrpc.robot.kinematics import Limits, Motion, Point
from taskrpc.robot.protocol import Plan, Pose, RobotStopped
from taskrpc.robot.world import World

SCAN_BEAMS = 360
"""The number of ranges in a scan: one per degree; the first points straight back."""
SCAN_RANGE = 12.0
"""Metres; a longer range is reported as this one."""

WORK_SECONDS = {"move": 0.0, "scan": 3.0, "report": 1.0}
"""Robot seconds of work after the drive, as in the lecture, by task type."""
_REPORT_PERIOD = 0.1  # real seconds
_REMEMBERED_PLANS = 4096

# The estimates assume that tasks follow each other without a gap. But timers fire late, and the
# server stores each result, so a real queue would fall behind its estimates with every task.
# Therefore a task that directly follows another starts at the instant at which the other ended,
# not when the timer fired. _MAX_GAP is shorter than the server's settle time, so a task that
# arrives at an idle robot starts at the present instant.
_MAX_LATENESS = 0.25  # real seconds that the timer of the end may be late
_MAX_GAP = 0.05  # real seconds between the return of one execute and the start of the next


class KinematicRobot:
    """A simulated robot that moves, scans and reports on a map; it satisfies `Robot`.

    Args:
        world: the map.
        speed: robot seconds that pass in one real second.
        start: its first pose; the dock by default.
        limits: its maximum speeds and accelerations.

    Raises:
        ValueError: `speed` is not a positive number, or the robot cannot stand at `start`.
    """

    task_types: Sequence[str] = tuple(WORK_SECONDS)

    def __init__(
        self,
        world: World,
        *,
        speed: float = 1.0,
        start: Pose | None = None,
        limits: Limits | None = None,
    ) -> None:
        if not 0.0 < speed < math.inf:
            raise ValueError(f"speed must be a positive number, not {speed!r}")
        pose = start or Pose(*world.dock, 0.0)
        if not world.is_free((pose.x, pose.y)):
            raise ValueError(f"the robot cannot stand at its start, {pose.x:g},{pose.y:g}")
        self.world = world
        self.speed = speed
        self._limits = limits or Limits()
        self._start = pose
        self._journal: RobotJournal | None = None
        self._course = self._made_course()
        self._is_running = self._is_paused = self._is_stopped = False
        self._loop: asyncio.AbstractEventLoop | None = None
        # Ends the sleep of `execute`: True from its timer, False from `_recheck`.
        self._waker: asyncio.Future[bool] | None = None
        self._last_end = self._last_return = -math.inf  # robot seconds on the loop's clock
        self._remembered_plan = lru_cache(_REMEMBERED_PLANS)(self._plan)

    def keep_journal(self, journal: RobotJournal) -> None:
        """Pass each step of the motion to `journal`, for a recording; call it before any task."""
        self._journal = journal
        self._course = self._made_course()

    def plan(self, task_type: str, target: str, start: Pose) -> Plan:
        """Return exactly how long the task takes and where it ends; see `Robot.plan`."""
        return self._remembered_plan(task_type, target, start)

    def pose(self) -> Pose:
        """Return the robot's current pose."""
        return self._course.pose(self._now())

    def remaining(self) -> float:
        """Return the robot seconds until the running task ends; 0.0 when idle."""
        return self._course.remaining(self._now())

    def planned_path(self) -> Sequence[Point]:
        """Return the points of the current drive in metres, its start first; none when idle."""
        return self._course.path()

    def battery(self) -> float:
        """Return the battery's charge in percent."""
        return self._course.level(self._now()).battery

    def odometer(self) -> float:
        """Return the metres driven since the start."""
        return self._course.level(self._now()).odometer

    async def execute(
        self, task_type: str, target: str, report: Callable[[float], None]
    ) -> dict[str, object]:
        """Drive to the target, do the work there and return the result; see `Robot.execute`.

        The result of a move has `pose` and `distance` (metres driven for it); a scan's has `pose`,
        `angle_min`, `angle_increment` (radians), `range_max` and `ranges` (metres); a report's has
        `pose`, `battery` (percent) and `odometer` (metres driven since the start).
        """
        if self._is_running:
            raise RuntimeError("the robot executes one task at a time, and one is running")
        before = self._course.standing
        self._begin(*self._task(task_type, target, before.pose))
        try:
            await self._follow(report)
        finally:
            self._finish()
        report(1.0)
        return self._result(task_type, self._course.standing.odometer - before.odometer)

    def pause(self) -> None:
        """Halt where the robot is; `resume` starts from rest, so the task takes longer."""
        self._is_paused = True
        self._halt()

    def resume(self) -> None:
        """Continue after `pause`."""
        self._is_paused = False
        if self._is_running and self._course.began is None:
            self._course.go(self._now())
            self._recheck()

    def stop(self) -> None:
        """Halt at once; a running `execute` ends with `RobotStopped`."""
        self._is_stopped = self._is_running
        self._halt()
        self._course.clear()

    def reset(self) -> None:
        """Put the idle robot to its start, with a full battery and 0 metres driven."""
        if self._is_running:
            raise RuntimeError("the robot executes a task: expected an idle robot")
        self._course = self._made_course()
        self._last_end = -math.inf

    def _made_course(self) -> Course:
        if self._journal is None:
            return Course(self._start, self.world.dock, self._limits)
        world, journal = self.world, self._journal
        return JournaledCourse(self._start, world.dock, self._limits, world, journal)

    def _task(self, task_type: str, target: str, start: Pose) -> tuple[Motion, float]:
        if task_type not in WORK_SECONDS:
            raise ValueError(f"unknown task {task_type!r}: expected {', '.join(WORK_SECONDS)}")
        waypoints = self.world.way((start.x, start.y), target)
        return Motion(start, waypoints, self._limits), WORK_SECONDS[task_type]

    def _plan(self, task_type: str, target: str, start: Pose) -> Plan:
        motion, work = self._task(task_type, target, start)
        return Plan(motion.duration + work, motion.end)

    def _result(self, task_type: str, distance: float) -> dict[str, object]:
        return task_result(task_type, self.world, self._course.standing, distance)

    def _now(self) -> float:
        """Return the robot seconds on the loop's clock; 0.0 before the first task."""
        return self._loop.time() * self.speed if self._loop else 0.0

    def _begin(self, motion: Motion, work: float) -> None:
        loop = asyncio.get_running_loop()
        if loop is not self._loop:
            self._loop, self._last_end = loop, -math.inf
            self._course.forget_clock()
        self._course.assign(motion, work)
        self._is_running = True
        if not self._is_paused:
            self._course.go(self._start_instant())
        self._last_end = -math.inf

    def _start_instant(self) -> float:
        now = self._now()
        timer_was_punctual = self._last_return - self._last_end <= _MAX_LATENESS * self.speed
        follows_directly = now - self._last_return <= _MAX_GAP * self.speed
        return self._last_end if timer_was_punctual and follows_directly else now

    async def _follow(self, report: Callable[[float], None]) -> None:
        """Wait until the task is complete."""
        progress = 0.0
        while not self._is_stopped:
            end = self._course.end()
            wake = min(end, self._now() + _REPORT_PERIOD * self.speed)
            slept = await self._sleep_until(None if end == math.inf else wake)
            if slept and wake == end == self._course.end():
                self._course.complete()
                self._last_end = end
                return
            progress = max(progress, self._course.progress(self._now()))
            report(progress)
        raise RobotStopped("the robot was stopped")

    async def _sleep_until(self, instant: float | None) -> bool:
        """Sleep until an instant (None: for ever); False if `_recheck` ended the sleep early."""
        loop = asyncio.get_running_loop()
        waker: asyncio.Future[bool] = loop.create_future()
        self._waker = waker
        timer = None if instant is None else loop.call_at(instant / self.speed, _wake, waker)
        try:
            return await waker
        finally:
            if timer:
                timer.cancel()

    def _finish(self) -> None:
        self._halt()
        self._course.clear()
        self._is_running = self._is_paused = self._is_stopped = False
        self._last_return = self._now()

    def _halt(self) -> None:
        self._course.halt(self._now())
        self._recheck()

    def _recheck(self) -> None:
        if self._waker and not self._waker.done():
            self._waker.set_result(False)


def _wake(waker: asyncio.Future[bool]) -> None:
    if not waker.done():
        waker.set_result(True)


def task_result(
    task_type: str, world: World, standing: Standing, distance: float
) -> dict[str, object]:
    """Return the result of a completed task; see `KinematicRobot.execute`."""
    pose = msgspec.structs.asdict(standing.pose)
    if task_type == "scan":
        return {"pose": pose, **_scan(world, standing.pose)}
    if task_type == "report":
        return {"pose": pose, "battery": standing.battery, "odometer": standing.odometer}
    return {"pose": pose, "distance": distance}


def _scan(world: World, pose: Pose) -> dict[str, object]:
    step = math.tau / SCAN_BEAMS
    angles = [step * beam - math.pi for beam in range(SCAN_BEAMS)]
    ranges = [round(metres, 4) for metres in world.cast(pose, angles, SCAN_RANGE)]
    return {
        "angle_min": -math.pi,
        "angle_increment": step,
        "range_max": SCAN_RANGE,
        "ranges": ranges,
    }
