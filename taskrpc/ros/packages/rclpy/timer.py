"""Timers, which call back periodically, and rates, which let a thread sleep periodically."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable
from typing import Any, ClassVar, Self

from ._impl.diagnostics.deadlocks import check_rate
from ._impl.diagnostics.explain import callback_parameters, like_ros, rate_unspun
from ._impl.execution.entity import Entity, is_busy, node_name
from .callback_groups import CallbackGroup
from .clock import Clock, ClockChange, TimeJump
from .clock_type import ClockType
from .context import Context
from .exceptions import InvalidHandle, RCLError, ROSInterruptException
from .handle import Handle
from .time import Time
from .utilities import get_default_context


class TimerInfo:
    """When the callback of a timer was due and when it ran, for callbacks with such a parameter."""

    def __init__(
        self,
        *,
        expected_call_time: int = 0,
        actual_call_time: int = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if expected_call_time < 0 or actual_call_time < 0:
            raise ValueError("call time values must not be negative")
        self._expected = Time(nanoseconds=expected_call_time, clock_type=clock_type)
        self._actual = Time(nanoseconds=actual_call_time, clock_type=clock_type)

    @property
    def expected_call_time(self) -> Time:
        """When it was due."""
        return self._expected

    @property
    def actual_call_time(self) -> Time:
        """When it was called."""
        return self._actual


class Timer(Entity):
    """Calls its callback once a period; `Node.create_timer` creates it.

    Missed periods are skipped; later calls keep the original rhythm.
    """

    is_timer: ClassVar[bool] = True

    def __init__(
        self,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None,
        timer_period_ns: int,
        clock: Clock,
        *,
        context: Context | None = None,
        autostart: bool = True,
    ) -> None:
        self._context = get_default_context() if context is None else context
        if timer_period_ns < 0:
            raise RCLError("failed to create timer: timer period must be non-negative")
        if timer_period_ns >= 2**63:
            raise TypeError(
                f"failed to create timer: expected a period below 2**63 ns, got {timer_period_ns}"
            )
        self._context.check_valid("failed to create timer")
        self.handle = Handle(self)
        self.callback = callback
        if callback is not None and _info_parameter(callback) is None:
            callback_parameters(callback, "the callback of a timer")
        self.callback_group = callback_group
        self._clock = clock
        self._period_ns = int(timer_period_ns)
        self._canceled = not autostart
        self._last_ns = clock.now_ns()
        self._next_ns = self._last_ns + self._period_ns
        self._credit_ns = 0
        self._inspected_callback: Callable[..., Any] | None = None
        self._info_name: str | None = None
        if clock.clock_type is ClockType.ROS_TIME:
            clock.add_timer(self)

    def destroy(self) -> None:
        """Stop calling back for ever."""
        self.handle.destroy_when_not_in_use()

    @property
    def clock(self) -> Clock:
        """Its clock."""
        return self._clock

    @property
    def timer_period_ns(self) -> int:
        """Nanoseconds between two calls; a new value applies after the next call."""
        self.handle.check()
        return self._period_ns

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        self.handle.check()
        self._period_ns = int(value)

    def is_ready(self) -> bool:
        """Whether it is due."""
        self.handle.check()
        return self.has_work()

    def is_canceled(self) -> bool:
        """Whether it was cancelled and not reset since."""
        self.handle.check()
        return self._canceled

    def cancel(self) -> None:
        """Stop calling back, until `reset`."""
        self.handle.check()
        self._canceled = True

    def reset(self) -> None:
        """Start a new period now; also after `cancel`."""
        self.handle.check()
        self._next_ns = self._clock.now_ns() + self._period_ns
        self._canceled = False
        self.notify_executor()

    def time_since_last_call(self) -> int:
        """Nanoseconds since the last call, or since it was created."""
        self.handle.check()
        return self._clock.now_ns() - self._last_ns

    def time_until_next_call(self) -> int | None:
        """Nanoseconds until it is due, negative when it is late; None while cancelled."""
        self.handle.check()
        return None if self._canceled else self._next_ns - self._clock.now_ns()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.destroy()

    def has_work(self) -> bool:
        """Whether it is due; also of a destroyed timer."""
        return not self._canceled and self._next_ns <= self._clock.now_ns()

    def nanoseconds_until_due(self) -> int | None:
        """The time until it is due; None while nothing but a jump of the clock can make it due."""
        if self._canceled or not self.handle.valid:
            return None
        wait = self._next_ns - self._clock.now_ns()
        if wait > 0 and self._clock.real_seconds(wait) is None:
            return None  # a jump of the clock will wake the executor
        return wait

    def take_work(self) -> Callable[[], Any] | None:
        """Begin the next period and return the call; None when it is not due."""
        self.handle.check()
        now = self._clock.now_ns()
        if self._canceled or self._next_ns > now:
            return None
        expected = self._next_ns
        self._last_ns = now
        self._next_ns = _following(expected, self._period_ns, now)
        callback = self.callback
        if callback is None or (passed := self._with_info(callback)) is None:
            return callback
        info = TimerInfo(
            expected_call_time=expected,
            actual_call_time=now,
            clock_type=self._clock.clock_type,
        )
        return lambda: passed(info)

    def _with_info(self, callback: Callable[..., Any]) -> Callable[[TimerInfo], Any] | None:
        """The call of a callback with a parameter that is annotated TimerInfo; None without one."""
        if callback is not self._inspected_callback:
            self._inspected_callback, self._info_name = callback, _info_parameter(callback)
        name = self._info_name
        return None if name is None else lambda info: callback(**{name: info})

    def before_jump(self, jump: TimeJump) -> None:
        """Keep the time that is left when the source of the time is about to change."""
        if jump.clock_change is not ClockChange.ROS_TIME_NO_CHANGE:
            self._credit_ns = self._next_ns - self._clock.now_ns()

    def after_jump(self, jump: TimeJump) -> None:
        """Calculate the next call again after a jump of the clock."""
        now = self._clock.now_ns()
        if jump.clock_change is not ClockChange.ROS_TIME_NO_CHANGE:
            self._next_ns = now + self._credit_ns
            self._last_ns = self._next_ns - self._period_ns
        elif now < self._last_ns:
            self._next_ns = now + self._period_ns
            self._last_ns = now
        self.notify_executor()


def _following(due: int, period: int, now: int) -> int:
    """When it is due next: whole periods after `due`, and after `now`."""
    if period == 0:
        return now
    return due + max(1, (now - due) // period + 1) * period


def _info_parameter(callback: Callable[..., Any]) -> str | None:
    try:
        parameters = inspect.signature(callback).parameters.values()
    except (TypeError, ValueError):  # some built-in functions have no signature
        return None
    return next((one.name for one in parameters if one.annotation is TimerInfo), None)


class Rate:
    """Sleeps until the next period of a timer; `Node.create_rate` creates it.

    Another thread must spin the node.
    """

    def __init__(self, timer: Timer, *, context: Context) -> None:
        self._timer = timer
        self._context = context
        self._is_shutdown = False
        self._is_destroyed = False
        self._event = threading.Event()
        self._lock = threading.Lock()
        self._num_sleepers = 0
        self._grace_ns = _GRACE_NS
        self._timer.callback = self._event.set
        context.on_shutdown(self._on_shutdown)

    def sleep(self) -> None:
        """Wait for the timer's next call.

        Raises ROSInterruptException when the context is shut down, RuntimeError once it is
        destroyed, WouldDeadlock in a callback that blocks the only thread that could run the timer.
        """
        self._check()
        check_rate(self._timer.parent_node)
        with self._lock:
            self._num_sleepers += 1
        try:
            self._wait()
        finally:
            with self._lock:
                self._num_sleepers -= 1
                if self._num_sleepers == 0 and not self._is_destroyed:
                    self._event.clear()
        if not self._context.ok():
            raise ROSInterruptException

    def destroy(self) -> None:
        """Wake the sleeping threads and refuse further sleeps."""
        self._is_destroyed = True
        self._event.set()

    def _wait(self) -> None:
        """Wait for the call of the timer; call it here when no thread spins the node."""
        while not self._event.wait(self._slice()) and self._context.ok():
            if self._is_unspun():
                if self._grace_ns:
                    self._grace_ns = 0
                    rate_unspun(node_name(self._timer.parent_node))
                if (call := self._timer.take_work()) is not None:
                    call()

    def _slice(self) -> float:
        left = self._timer.nanoseconds_until_due()
        if self._grace_ns or left is None:
            return _SLICE
        return min(_SLICE, max(0, left) * 1e-9)

    def _is_unspun(self) -> bool:
        """Whether the timer is so late that apparently no thread spins the node."""
        left = self._timer.nanoseconds_until_due()
        if left is None or left + self._grace_ns > 0 or like_ros():
            return False
        return not is_busy(self._timer.parent_node.executor)

    def _check(self) -> None:
        if self._is_shutdown or not self._context.ok():
            raise ROSInterruptException
        if self._is_destroyed:
            raise RuntimeError("Rate cannot sleep because it has been destroyed")
        if not self._timer.handle.valid:
            self.destroy()
            raise InvalidHandle("Rate cannot sleep because the timer has been destroyed")

    def _on_shutdown(self) -> None:
        self._is_shutdown = True
        self.destroy()


_SLICE = 0.1
"""Seconds of one wait: on Windows, Ctrl-C cannot interrupt a wait."""
_GRACE_NS = 1_000_000_000
"""The lateness of a timer from which we conclude that no thread spins the node."""
