"""What `taskrpc task watch` prints: a line for each change that somebody would want to read."""

from __future__ import annotations

import json
import sys
from datetime import datetime
from typing import Any

from taskrpc.cli.task.task_services import Update
from taskrpc.cli.task.view import as_object, news

_STEPS = 4  # lines of progress in a task's run


class Printer:
    """Prints what is new in each update to stdout.

    Args:
        as_json: one object a line, and every step of progress.
    """

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._shown: dict[int, Any] = {}
        self._paused = False

    def show(self, update: Update) -> None:
        """Print what is new."""
        if update.paused != self._paused:
            self._paused = update.paused
            self._print_pause()
        for task in update.tasks:
            shown = self._essence(task)
            if self._shown.get(task.task_id) != shown:
                self._shown[task.task_id] = shown
                self._print(json.dumps(as_object(task)) if self._as_json else _timed(news(task)))
        sys.stdout.flush()

    def _essence(self, task: Any) -> Any:
        """What of a task makes a new line when it changes."""
        progress = task.progress if self._as_json else int(task.progress * _STEPS)
        return task.state, task.priority, progress, task.submitted.sec

    def _print_pause(self) -> None:
        text = "the queue is paused" if self._paused else "the queue goes on"
        self._print(json.dumps({"paused": self._paused}) if self._as_json else _timed(text))

    @staticmethod
    def _print(line: str) -> None:
        print(line)


def _timed(text: str) -> str:
    return f"{datetime.now():%H:%M:%S}  {text}"
