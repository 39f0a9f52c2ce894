"""Tasks as the messages of taskrpc_interfaces."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec

import srvgen
from taskrpc.tasks.model import EstimateChange, Task

_EARLIEST, _LATEST = -(2.0**31), 2.0**31 - 1  # what fits into builtin_interfaces/msg/Time


class Messages:
    """Writes tasks as messages; the message classes are loaded when it is made."""

    def __init__(self) -> None:
        self._task_info = srvgen.load("taskrpc_interfaces/msg/TaskInfo")
        self._estimate_change = srvgen.load("taskrpc_interfaces/msg/EstimateChange")
        self._time = srvgen.load("builtin_interfaces/msg/Time")

    def task_info(self, task: Task, estimated_time: float) -> Any:
        """A task as a list shows it: without its result and the changes of its estimate."""
        return self._task_info(
            task_id=task.task_id,
            task_type=task.task_type,
            target=task.target,
            priority=task.priority,
            state=task.state.value,
            estimated_time=estimated_time,
            accepted_estimate=task.accepted_estimate,
            progress=task.progress,
            message=task.message,
            client=task.client,
            submitted=self._instant(task.submitted_at),
            started=self._instant(task.started_at),
            ended=self._instant(task.ended_at),
        )

    def whole_task_info(
        self, task: Task, estimated_time: float, changes: Iterable[EstimateChange]
    ) -> Any:
        """A task with everything that is known about it."""
        info = self.task_info(task, estimated_time)
        info.result = task.result
        info.estimate_changes = [
            self._estimate_change(**msgspec.structs.asdict(change)) for change in changes
        ]
        return info

    def _instant(self, seconds: float | None) -> Any:
        # What a clock said that was wrong by decades must not keep a whole list from being sent.
        whole, fraction = divmod(min(max(seconds or 0.0, _EARLIEST), _LATEST), 1)
        return self._time(sec=int(whole), nanosec=int(fraction * 1e9))
