"""The time after which an action server forgets results."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from ...clock import Clock, JumpThreshold, TimeJump
from ...duration import Duration

_ANY_JUMP = JumpThreshold(
    min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1)
)


class ResultClock:
    """Simulated time if the node's clock has it, else a time that never jumps.

    `changed` is called when simulated time advances; it must not block.
    """

    def __init__(self, clock: Clock, changed: Callable[[], object]) -> None:
        self._clock: Any = clock
        self._changed = changed
        self._handle = clock.create_jump_callback(_ANY_JUMP, post_callback=self._jumped)

    @property
    def is_simulated(self) -> bool:
        """Whether a simulation sets the time."""
        return bool(self._clock.ros_time_is_active)

    def now(self) -> float:
        """The time in seconds."""
        if self.is_simulated:
            return float(self._clock.now_ns() * 1e-9)
        return time.monotonic()

    def close(self) -> None:
        """Report no more changes."""
        self._handle.unregister()

    def _jumped(self, _: TimeJump) -> None:
        self._changed()
