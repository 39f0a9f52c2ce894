"""The clock of an AsyncNode, on which coroutines sleep."""

from __future__ import annotations

import asyncio

from ..clock import Clock, ClockChange, JumpHandle, JumpThreshold, ROSClock, TimeJump
from ..clock_type import ClockType
from ..duration import Duration
from ..exceptions import TimeSourceChangedError


class AsyncClock(ROSClock):
    """A clock with `await clock.sleep(seconds)`, which follows simulated time."""

    _sleeps: dict[asyncio.Future[None], int | None]
    """The coroutines that sleep; for simulated time, when each of them wakes, in nanoseconds."""
    _jumps: JumpHandle

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> AsyncClock:
        """Create a clock of this kind; raises TypeError for another type."""
        self: AsyncClock = Clock.__new__(cls, clock_type=clock_type)  # type: ignore[assignment]
        self._sleeps = {}
        self._jumps = self.create_jump_callback(_LATER, post_callback=self._jumped)
        return self

    async def sleep(self, duration_sec: float) -> None:
        """Sleep for so many seconds of this clock.

        The destruction of the node cancels it. Raises TimeSourceChangedError when simulated time is
        switched on or off meanwhile, RuntimeError on the clock of a destroyed node.
        """
        if not self.handle.valid:
            raise RuntimeError("Cannot sleep on a destroyed clock")
        nanoseconds = Duration(seconds=duration_sec).nanoseconds
        if nanoseconds <= 0:
            await asyncio.sleep(0)
            return
        loop = asyncio.get_running_loop()
        over: asyncio.Future[None] = loop.create_future()
        seconds = self.real_seconds(nanoseconds)
        alarm = None if seconds is None else loop.call_later(seconds, _wake, over)
        self._sleeps[over] = self.now_ns() + nanoseconds if alarm is None else None
        try:
            await over
        finally:
            del self._sleeps[over]
            if alarm is not None:
                alarm.cancel()

    def now_ns(self) -> int:
        """The time now, in nanoseconds."""
        return super().now_ns() if self.ros_time_is_active else Clock.now_ns(self)

    def destroy(self) -> None:
        """Cancel all sleeps; the node does this at its end."""
        if self.handle.valid:
            self.handle.destroy_when_not_in_use()
            self._jumps.unregister()
            for over in self._sleeps:
                over.cancel()

    def _jumped(self, jump: TimeJump) -> None:
        changed = jump.clock_change is not ClockChange.ROS_TIME_NO_CHANGE
        now = self.now_ns()
        for over, end in self._sleeps.items():
            if changed and not over.done():
                over.set_exception(TimeSourceChangedError())
            elif end is not None and now >= end:
                _wake(over)


def _wake(over: asyncio.Future[None]) -> None:
    if not over.done():
        over.set_result(None)


_LATER = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None)
