"""An executor that ignores callback groups and runs tasks in the order of their creation."""

from __future__ import annotations

from typing import Any, ClassVar

from ..executors import SingleThreadedExecutor
from ..task import Future


class EventsExecutor(SingleThreadedExecutor):
    """As SingleThreadedExecutor, but callback groups have no effect.

    A callback that awaits something does not delay another one.
    """

    _respects_groups: ClassVar[bool] = False

    def spin_until_future_complete(
        self, future: Future[Any], timeout_sec: float | None = None
    ) -> None:
        """Run callbacks until the future is done or cancelled, `timeout_sec` seconds at most.

        Also runs the callbacks that are ready by then, and those that they make ready.
        """
        super().spin_until_future_complete(future, timeout_sec)
        is_over = self._wake_for(future)
        while not is_over() and self._context.ok():
            if (work := self._next(0, None, is_over)) is None:
                return
            self._run(work)
