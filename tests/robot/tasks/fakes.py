"""A robot on a line with switchable faults, and a store that fails."""

import asyncio

from taskrpc.errors import OutcomeUnknown, StoreError
from taskrpc.robot.protocol import Plan, Pose, RobotStopped, TargetError
from taskrpc.robot.tasks.records.history import DEFAULT
from taskrpc.robot.tasks.records.store import MemoryStore


class LineRobot:
    """Drives along x to the target at 1 m/s, turns in a second a radian, works for a second.

    Args:
        speed: robot seconds in a real second.
        slowness: how many times longer everything takes than planned.
    """

    task_types = ("move", "scan", "report")

    def __init__(self, *, speed=1.0, slowness=1.0):
        self.speed = speed
        self.slowness = slowness
        self.fail_with = None
        self.ignores_cancel = False
        self.log = []
        self._pose = Pose(0.0, 0.0, 0.0)
        self._plan = None
        self._done = 0.0  # robot seconds of the plan that are behind
        self._since = None  # on the loop's clock, while it moves
        self._paused = self._stopped = False
        self._wake = asyncio.Event()

    def plan(self, task_type, target, start):
        try:
            x = float(target)
        except ValueError:
            raise TargetError(f"expected a number, got {target!r}") from None
        theta = start.theta if x == start.x else (1.0 if x > start.x else -1.0)
        return Plan(abs(x - start.x) + abs(theta - start.theta) + 1.0, Pose(x, 0.0, theta))

    def pose(self):
        return self._where()

    def remaining(self):
        return self._left()

    def _where(self):
        if self._plan is None:
            return self._pose
        share = min(1.0, self._behind() / self._plan.seconds)
        x = self._pose.x + share * (self._plan.end.x - self._pose.x)
        return Pose(x, 0.0, self._plan.end.theta)

    def _left(self):
        return 0.0 if self._plan is None else (self._plan.seconds - self._behind()) * self.slowness

    def pause(self):
        self._hold()
        self._paused = True
        self._wake.set()

    def resume(self):
        self._paused = False
        self._wake.set()

    def stop(self):
        self._stopped = self._plan is not None
        self._wake.set()

    async def execute(self, task_type, target, report):
        assert self._plan is None, "two tasks at once"
        self.log.append((task_type, target))
        self._plan, self._done = self.plan(task_type, target, self._pose), 0.0
        try:
            await self._follow(report)
            self._done = self._plan.seconds
            return {"x": self._plan.end.x}
        finally:
            self._hold()
            self._pose, self._plan = self._where(), None
            self._paused = self._stopped = False

    async def _follow(self, report):
        while self._left() > 1e-9:
            if self._stopped:
                raise RobotStopped("stopped")
            if self._paused:
                await self._woken(None)
                continue
            if self.fail_with and self._behind() > 0:
                raise self.fail_with
            self._since = asyncio.get_running_loop().time()
            await self._woken(min(self._left(), 0.5) / self.speed)
            self._hold()
            report(self._done / self._plan.seconds)

    async def _woken(self, timeout):
        try:
            await asyncio.wait_for(self._wake.wait(), timeout)
        except TimeoutError:
            pass
        except asyncio.CancelledError:
            if not self.ignores_cancel:
                raise
        self._wake.clear()

    def _behind(self):
        if self._since is None:
            return self._done
        real = asyncio.get_running_loop().time() - self._since
        return self._done + real * self.speed / self.slowness

    def _hold(self):
        self._done, self._since = self._behind(), None


class FullStore(MemoryStore):
    """A store on a disk that may be full, and slow."""

    def __init__(self, history=DEFAULT):
        super().__init__(history=history)
        self.is_full = False
        self.is_lost = False
        self.delay = 0.0

    async def apply(self, saved, forgotten=(), completion=None, clients=()):
        if self.delay:
            await asyncio.sleep(self.delay)
        if self.is_full:
            raise StoreError("the disk is full")
        if self.is_lost:
            raise OutcomeUnknown("the effect on the disk is unknown")
        await super().apply(saved, forgotten, completion, clients)

    async def remember_pause(self, paused):
        if self.is_full:
            raise StoreError("the disk is full")
        await super().remember_pause(paused)
