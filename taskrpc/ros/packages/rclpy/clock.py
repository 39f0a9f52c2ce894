"""Clocks: the system clock, the steady clock, and the ROS clock, which a simulation may set."""

from __future__ import annotations

import enum
import time as _time
import weakref
from collections.abc import Callable
from typing import Any, Protocol, Self, TypedDict

from ._impl.execution.wakeups import Sleep
from .clock_type import ClockType
from .context import Context
from .duration import Duration
from .exceptions import NotInitializedException
from .handle import Handle
from .time import Time
from .utilities import get_default_context


class ClockChange(enum.IntEnum):
    """Whether a jump came from a change of the time source."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


class JumpThreshold:
    """Which jumps are reported: those of a minimum size, and changes of the time source.

    `min_forward` is positive or None, `min_backward` negative or None; ValueError otherwise, and
    when no jump would ever be reported.
    """

    def __init__(
        self,
        *,
        min_forward: Duration | None,
        min_backward: Duration | None,
        on_clock_change: bool = True,
    ) -> None:
        if min_forward is not None and min_forward.nanoseconds <= 0:
            raise ValueError("min_forward must be a positive non-zero duration")
        if min_backward is not None and min_backward.nanoseconds >= 0:
            raise ValueError("min_backward must be a negative non-zero duration")
        if min_forward is None and min_backward is None and not on_clock_change:
            raise ValueError("At least one jump threshold must be enabled")
        self.min_forward = min_forward
        self.min_backward = min_backward
        self.on_clock_change = on_clock_change

    def exceeded_by(self, jump: TimeJump) -> bool:
        """Whether this jump must be reported."""
        if jump.clock_change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED):
            return self.on_clock_change
        if self.min_forward is not None and jump.delta >= self.min_forward:
            return True
        return self.min_backward is not None and jump.delta <= self.min_backward


class TimeJumpDictionary(TypedDict):
    """A jump as a dict, with nanoseconds, for annotations."""

    clock_change: ClockChange
    delta: int


class TimeJump:
    """A jump of a clock: how far it was, and whether the time source changed."""

    def __init__(self, clock_change: ClockChange, delta: Duration) -> None:
        if not isinstance(clock_change, ClockChange):
            raise TypeError("clock_change must be an instance of rclpy.clock.ClockChange")
        self._clock_change = clock_change
        self._delta = delta

    @property
    def clock_change(self) -> ClockChange:
        """Whether the time source changed."""
        return self._clock_change

    @property
    def delta(self) -> Duration:
        """How far the clock jumped; negative when it jumped back."""
        return self._delta


class JumpHandle:
    """The registration of jump callbacks; `unregister()` or the end of its `with` block ends it."""

    def __init__(
        self,
        *,
        clock: Clock,
        threshold: JumpThreshold,
        pre_callback: Callable[[], Any] | None,
        post_callback: Callable[[TimeJump], Any] | None,
    ) -> None:
        if pre_callback is None and post_callback is None:
            raise ValueError("One of pre_callback or post_callback must be callable")
        if pre_callback is not None and not callable(pre_callback):
            raise ValueError("pre_callback must be callable if given")
        if post_callback is not None and not callable(post_callback):
            raise ValueError("post_callback must be callable if given")
        self.threshold = threshold
        self.pre_callback = pre_callback
        self.post_callback = post_callback
        self._clock: Clock | None = clock
        clock._jump_handles.append(self)

    def unregister(self) -> None:
        """Remove the callbacks."""
        if self._clock is not None:
            self._clock._jump_handles.remove(self)
            self._clock = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.unregister()


class JumpListener(Protocol):
    """A timer, which a clock informs of its jumps."""

    def before_jump(self, jump: TimeJump) -> None:
        """The clock is about to jump."""

    def after_jump(self, jump: TimeJump) -> None:
        """The clock has jumped."""


class Clock:
    """A clock of the given kind; `Clock(clock_type=ClockType.ROS_TIME)` is a ROSClock."""

    _clock_type: ClockType
    _handle: Handle
    _jump_handles: list[JumpHandle]
    _timers: weakref.WeakKeyDictionary[JumpListener, None]

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> Clock:
        """Create a clock of the class for its kind; raises TypeError for another type."""
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        is_ros = clock_type is ClockType.ROS_TIME and cls is Clock
        self = super().__new__(ROSClock if is_ros else cls)
        self._clock_type = clock_type
        self._handle = Handle(self)
        self._jump_handles = []
        self._timers = weakref.WeakKeyDictionary()
        if isinstance(self, ROSClock):
            self._override_ns, self._active = 0, False
        return self

    @property
    def clock_type(self) -> ClockType:
        """The kind of clock."""
        return self._clock_type

    @property
    def handle(self) -> Handle:
        """Its handle."""
        return self._handle

    def __repr__(self) -> str:
        return f"Clock(clock_type={self._clock_type.name})"

    def now(self) -> Time:
        """The time now."""
        return Time(nanoseconds=self.now_ns(), clock_type=self._clock_type)

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: Callable[[], Any] | None = None,
        post_callback: Callable[[TimeJump], Any] | None = None,
    ) -> JumpHandle:
        """Call these before and after jumps; the callbacks must not block."""
        return JumpHandle(
            clock=self,
            threshold=threshold,
            pre_callback=pre_callback,
            post_callback=post_callback,
        )

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Sleep until this clock shows the time; returns False when the sleep ended earlier.

        The shutdown of the context ends it, and so does switching ROS time on or off.
        Raises ValueError for the time of another clock, NotInitializedException without a
        running context.
        """
        context = get_default_context() if context is None else context
        if not context.ok():
            raise NotInitializedException
        if until.clock_type != self._clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        sleep = Sleep()
        context.add_sleep(sleep)
        changed: list[TimeJump] = []

        def jumped(jump: TimeJump) -> None:
            if jump.clock_change is not ClockChange.ROS_TIME_NO_CHANGE:
                changed.append(jump)
            sleep.end()

        with self.create_jump_callback(_ANY_JUMP, post_callback=jumped):
            while True:
                seen = sleep.state
                if changed or not context.ok():
                    return False
                left = until.nanoseconds - self.now_ns()
                if left <= 0:
                    return True
                sleep.until_ended(seen, self.real_seconds(left))

    def sleep_for(self, rel_time: Duration, context: Context | None = None) -> bool:
        """Sleep for a duration of this clock; see `sleep_until`."""
        return self.sleep_until(self.now() + rel_time, context)

    def add_timer(self, timer: JumpListener) -> None:
        """Inform a timer of jumps for as long as it lives."""
        self._timers[timer] = None

    def now_ns(self) -> int:
        """The time now, in nanoseconds."""
        if self._clock_type is ClockType.STEADY_TIME:
            return _time.perf_counter_ns()
        return _time.time_ns()

    def real_seconds(self, nanoseconds: int) -> float | None:
        """The real seconds that this clock needs for so many nanoseconds; None if unknown."""
        return nanoseconds * 1e-9


class ROSClock(Clock):
    """The system time, until a time source switches it to the time from `/clock`."""

    _override_ns: int
    _active: bool

    def __new__(cls) -> ROSClock:
        """Create a clock that shows the system time."""
        return super().__new__(cls, clock_type=ClockType.ROS_TIME)  # type: ignore[return-value]

    @property
    def ros_time_is_active(self) -> bool:
        """Whether a simulation sets the time."""
        return self._active

    def set_ros_time_override(self, time: Time) -> None:
        """Set the time that it shows while ROS time is active."""
        if not isinstance(time, Time):
            raise TypeError(
                f"Time must be specified as rclpy.time.Time. Received type: {type(time)}"
            )
        if not self._active:
            self._override_ns = time.nanoseconds
            return
        delta = Duration(nanoseconds=time.nanoseconds - self._override_ns)
        jump = TimeJump(ClockChange.ROS_TIME_NO_CHANGE, delta)

        def change() -> None:
            self._override_ns = time.nanoseconds

        self._jump(jump, change)

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        if enabled == self._active:
            return
        changed = ClockChange.ROS_TIME_ACTIVATED if enabled else ClockChange.ROS_TIME_DEACTIVATED

        def change() -> None:
            self._active = enabled

        self._jump(TimeJump(changed, Duration()), change)

    def _jump(self, jump: TimeJump, change: Callable[[], None]) -> None:
        """Change the time; inform timers and jump callbacks before and after."""
        handles = [handle for handle in self._jump_handles if handle.threshold.exceeded_by(jump)]
        timers = list(self._timers)
        for handle in handles:
            if handle.pre_callback is not None:
                handle.pre_callback()
        for timer in timers:
            timer.before_jump(jump)
        change()
        for timer in timers:
            timer.after_jump(jump)
        for handle in handles:
            if handle.post_callback is not None:
                handle.post_callback(jump)

    def now_ns(self) -> int:
        """The time now, in nanoseconds."""
        return self._override_ns if self._active else _time.time_ns()

    def real_seconds(self, nanoseconds: int) -> float | None:
        """The real seconds for so many nanoseconds; None while a simulation sets the time."""
        return None if self._active else nanoseconds * 1e-9


_ANY_JUMP = JumpThreshold(
    min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1)
)

__all__ = [
    "Clock",
    "ClockChange",
    "ClockType",
    "Duration",
    "JumpHandle",
    "JumpThreshold",
    "ROSClock",
    "Time",
    "TimeJump",
]
