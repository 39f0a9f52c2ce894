"""The history: which ended tasks are kept, and how many of them a server has in memory."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import msgspec

from taskrpc.robot.tasks.model import Task

AT_ONCE = 100
"""The most tasks that one change removes, so that no change takes long."""


class History(msgspec.Struct, frozen=True):
    """Which ended tasks are kept; the rule is the same for one robot and for a fleet.

    Interrupted tasks do not count and are always kept: an operator decides about each of them.
    A task is removed when another one ends, at most `AT_ONCE` at a time.
    """

    count: int | None = 1000
    """How many ended tasks are kept; None for no limit."""
    seconds: float | None = None
    """How long an ended task is kept after its end; None for no limit."""
    recent: int = 1000
    """How many of them a server has in memory at most. The older ones are only in the database:
    an export contains them, and the services do not show them."""

    @property
    def in_memory(self) -> int:
        """How many ended tasks a server has in memory at most."""
        return self.recent if self.count is None else min(self.count, self.recent)

    @property
    def archived(self) -> int | None:
        """How many older tasks the database keeps at most; None for no limit."""
        return None if self.count is None else self.count - self.in_memory

    def kept_since(self, now: float) -> float | None:
        """Return the earliest end of the tasks that are kept now; None for no limit."""
        return None if self.seconds is None else now - self.seconds

    def surplus(self, ended: Iterable[Task], count: int, now: float) -> list[int]:
        """Return the ids of the tasks that leave the memory.

        Args:
            ended: ended tasks that may leave, the oldest end first.
            count: the number of all ended tasks, without the interrupted ones.
            now: when the newest task ended.
        """
        kept_since, surplus = self.kept_since(now), list[int]()
        for task in islice(ended, AT_ONCE):
            is_old = kept_since is not None and (task.ended_at or 0.0) < kept_since
            if not is_old and count - len(surplus) <= self.in_memory:
                break
            surplus.append(task.task_id)
        return surplus


DEFAULT = History()
"""The newest 1,000."""


def newest_end(tasks: Iterable[Task]) -> float | None:
    """Return when the last of some tasks ended; None if none of them has ended."""
    ends = [task.ended_at or 0.0 for task in tasks if task.state.is_ended]
    return max(ends, default=None)
