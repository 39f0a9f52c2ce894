"""An executor that takes tasks in the order in which they were made."""

from __future__ import annotations

from typing import ClassVar

from ..executors import SingleThreadedExecutor


class EventsExecutor(SingleThreadedExecutor):
    """As SingleThreadedExecutor, which is woken by events here, too; tasks run oldest first."""

    _youngest_first: ClassVar[bool] = False
