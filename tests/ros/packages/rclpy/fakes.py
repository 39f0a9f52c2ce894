"""A clock and a node for tests of executors, without any network."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from taskrpc.ros.packages.rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from taskrpc.ros.packages.rclpy.clock import Clock, ClockType
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.guard_condition import GuardCondition
from taskrpc.ros.packages.rclpy.timer import Timer
from taskrpc.ros.packages.rclpy.waitable import Waitable


class FakeClock:
    """A clock that stands still until `go_on` moves it."""

    clock_type = ClockType.STEADY_TIME

    def __init__(self) -> None:
        self.ns = 0

    def go_on(self, seconds: float) -> None:
        self.ns += int(seconds * 1e9)

    def now_ns(self) -> int:
        return self.ns

    def real_seconds(self, nanoseconds: int) -> float | None:
        return None


class FakeNode:
    def __init__(self, context: Context) -> None:
        self.context = context
        self.executor: Any = None
        self.guards: list[GuardCondition] = []
        self.timers: list[Timer] = []
        self.waitables: list[Waitable[Any]] = []
        self.subscriptions = self.clients = self.services = ()
        self.group = MutuallyExclusiveCallbackGroup()
        self.destroyed = False

    def guard(
        self, callback: Callable[..., Any], group: CallbackGroup | None = None
    ) -> GuardCondition:
        made = GuardCondition(callback, group or self.group, self.context)
        self._add(self.guards, made)
        return made

    def timer(self, period: float, callback: Callable[..., Any], clock: Any = None) -> Timer:
        clock = clock or Clock(clock_type=ClockType.STEADY_TIME)
        made = Timer(callback, self.group, int(period * 1e9), clock, context=self.context)
        self._add(self.timers, made)
        return made

    def add_waitable(self, waitable: Waitable[Any]) -> None:
        self._add(self.waitables, waitable)

    def destroy_node(self) -> None:
        self.destroyed = True

    def _add(self, entities: list[Any], made: Any) -> None:
        made.parent_node = self
        made.callback_group.add_entity(made)
        entities.append(made)
        if self.executor is not None:
            self.executor.wake()
