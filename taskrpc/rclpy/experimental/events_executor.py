"""An executor that takes everything in the order in which it came, and heeds no groups."""

from __future__ import annotations

from typing import Any, ClassVar

from ..executors import SingleThreadedExecutor
from ..task import Future


class EventsExecutor(SingleThreadedExecutor):
    """As SingleThreadedExecutor, which is woken by events here, too; but tasks run oldest first.

    Callback groups are without effect: a callback that awaits something holds up no other.
    """

    _youngest_first: ClassVar[bool] = False
    _respects_groups: ClassVar[bool] = False

    def spin_until_future_complete(
        self, future: Future[Any], timeout_sec: float | None = None
    ) -> None:
        """Run callbacks until the future is done or cancelled, `timeout_sec` seconds at most.

        What is there by then is still run, also what follows from it.
        """
        super().spin_until_future_complete(future, timeout_sec)
        is_over = self._wake_for(future)
        while not is_over() and self._context.ok():
            if (work := self._next(0, None, is_over)) is None:
                return
            self._run(work)
