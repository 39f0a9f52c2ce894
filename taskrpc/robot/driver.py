"""The simulated robot: a `Course` looked at, and waited for, through the event loop's clock."""

import asyncio
import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import msgspec

from taskrpc.robot.course import Course
from taskrpc.robot.kinematics import Limits, Motion
from taskrpc.robot.protocol import Plan, Pose, RobotStopped
from taskrpc.robot.world import World

SCAN_BEAMS = 360
"""Ranges in a scan: one a degree, all around; the first looks straight back."""
SCAN_RANGE = 12.0
"""Metres; what is further away reads as this."""

_WORK_SECONDS = {"move": 0.0, "scan": 3.0, "report": 1.0}  # after the drive; the lecture's figures
_REPORT_PERIOD = 0.1  # real seconds
_REMEMBERED_PLANS = 4096

# The estimate of a queued task assumes that the tasks ahead of it follow each other without a gap.
# But timers fire late, and the server writes each result down, so a real queue would lag further
# behind its estimates with every task. Hence a task that is taken up directly after another one
# starts at the instant at which the other one ended, not when we noticed. The handover stays below
# the server's settle time, so that a task which arrives at an idle robot starts at once.
_LATENESS = 0.25  # real seconds that the timer of the end may be late
_HANDOVER = 0.05  # real seconds between the return of one execute and the start of the next


class KinematicRobot:
    """A simulated robot that moves, scans and reports on a map; it satisfies `Robot`.

    Args:
        world: the map that it drives on.
        speed: robot seconds that pass in one real second.
        start: where it stands at first; the dock unless said.
        limits: how fast it may be.

    Raises:
        ValueError: `speed` is not a positive number, or the robot cannot stand at `start`.
    """

    task_types: Sequence[str] = tuple(_WORK_SECONDS)

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
        self._course = Course(pose, world.dock, self._limits)
        self._is_running = self._is_paused = self._is_stopped = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waker: asyncio.Future[bool] | None = None
        self._last_end = self._last_return = -math.inf  # robot seconds on the loop's clock
        self._remembered_plan = lru_cache(_REMEMBERED_PLANS)(self._plan)

    def plan(self, task_type: str, target: str, start: Pose) -> Plan:
        """Say exactly how long the task takes from `start` and where it ends; see `Robot.plan`."""
        return self._remembered_plan(task_type, target, start)

    def pose(self) -> Pose:
        """Say where the robot is now."""
        return self._course.pose(self._now())

    def remaining(self) -> float:
        """Robot seconds until the running task ends; 0.0 when idle."""
        return self._course.remaining(self._now())

    async def execute(
        self, task_type: str, target: str, report: Callable[[float], None]
    ) -> dict[str, object]:
        """Drive to the target, do the work there and return the result; see `Robot.execute`.

        The result of a move has `pose` and `distance` (metres driven for it); a scan's has `pose`,
        `angle_min`, `angle_increment` (radians), `range_max` and `ranges` (metres); a report's has
        `pose`, `battery` (percent) and `odometer` (metres driven ever).
        """
        if self._is_running:
            raise RuntimeError("the robot does one task at a time, and one is running")
        before = self._course.standing
        self._begin(*self._task(task_type, target, before.pose))
        try:
            await self._follow(report)
        finally:
            self._finish()
        report(1.0)
        return self._result(task_type, self._course.standing.odometer - before.odometer)

    def pause(self) -> None:
        """Halt where the robot is; `resume` accelerates again, so the task takes longer."""
        self._is_paused = True
        self._halt()

    def resume(self) -> None:
        """Go on after `pause`."""
        self._is_paused = False
        if self._is_running and self._course.began is None:
            self._course.go(self._now())
            self._look_again()

    def stop(self) -> None:
        """Halt at once; a running `execute` ends with `RobotStopped`."""
        self._is_stopped = self._is_running
        self._halt()
        self._course.clear()

    def _task(self, task_type: str, target: str, start: Pose) -> tuple[Motion, float]:
        if task_type not in _WORK_SECONDS:
            raise ValueError(f"unknown task {task_type!r}: expected {', '.join(_WORK_SECONDS)}")
        waypoints = self.world.way((start.x, start.y), target)
        return Motion(start, waypoints, self._limits), _WORK_SECONDS[task_type]

    def _plan(self, task_type: str, target: str, start: Pose) -> Plan:
        motion, work = self._task(task_type, target, start)
        return Plan(motion.duration + work, motion.end)

    def _result(self, task_type: str, distance: float) -> dict[str, object]:
        standing = self._course.standing
        pose = msgspec.structs.asdict(standing.pose)
        if task_type == "scan":
            return {"pose": pose, **_scan(self.world, standing.pose)}
        if task_type == "report":
            return {"pose": pose, "battery": standing.battery, "odometer": standing.odometer}
        return {"pose": pose, "distance": distance}

    def _now(self) -> float:
        """Robot seconds on the loop's clock; before the first task there is none to ask."""
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
        noticed_in_time = self._last_return - self._last_end <= _LATENESS * self.speed
        taken_up_directly = now - self._last_return <= _HANDOVER * self.speed
        return self._last_end if noticed_in_time and taken_up_directly else now

    async def _follow(self, report: Callable[[float], None]) -> None:
        """Wait until nothing of the task lies ahead."""
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
        """Sleep until then, or (None) without end; False if `_look_again` ended it early."""
        loop = asyncio.get_running_loop()
        waker: asyncio.Future[bool] = loop.create_future()
        self._waker = waker
        timer = None if instant is None else loop.call_at(instant / self.speed, _ring, waker)
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
        self._look_again()

    def _look_again(self) -> None:
        if self._waker and not self._waker.done():
            self._waker.set_result(False)


def _ring(waker: asyncio.Future[bool]) -> None:
    if not waker.done():
        waker.set_result(True)


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
