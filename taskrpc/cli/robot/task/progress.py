"""Shows the progress of tasks: a bar on a terminal, otherwise a line for each new state."""

from __future__ import annotations

import json
import sys
from contextlib import AbstractContextManager
from datetime import datetime
from typing import TYPE_CHECKING, Any, Protocol, Self

from taskrpc.cli.robot.task.task_services import Update
from taskrpc.cli.robot.task.view import as_object, in_seconds, status_line
from taskrpc.observe.texts import work_of

if TYPE_CHECKING:
    from rich.console import Console

    from srvgen.stubs.taskrpc_interfaces.msg import TaskInfo

_WIDE = 72
"""Columns of a terminal that has room for the bar and the description of the work."""

_STEPS = 4  # lines of progress while a task runs


class Progress(AbstractContextManager[Any], Protocol):
    """Shows one task until its end."""

    def show(self, task: TaskInfo, *, paused: bool) -> None:
        """Show the task's current state; `paused` means that the queue is paused."""


def progress() -> Progress:
    """Return a bar if stderr is a terminal, otherwise lines."""
    if sys.stderr.isatty():
        from rich.console import Console

        console = Console(stderr=True)
        if console.is_terminal and not console.is_dumb_terminal:
            return ProgressBar(console)
    return ProgressLines()


class ProgressLines:
    """One line for each new state."""

    def __init__(self) -> None:
        self._shown: tuple[str, bool] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        return None

    def show(self, task: TaskInfo, *, paused: bool) -> None:
        """Print the task if its state is new."""
        if self._shown == (task.state, paused) or task.ended.sec:
            return
        self._shown = task.state, paused
        note = "  (the queue is paused: taskrpc task resume)" if paused else ""
        print(f"{status_line(task)}{note}", file=sys.stderr, flush=True)


class ProgressBar:
    """A bar that fills while the task runs, with the time until its end."""

    def __init__(self, console: Console) -> None:
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as Bars

        self._is_narrow = console.width < _WIDE
        bar = () if self._is_narrow else (BarColumn(bar_width=24),)
        self._bars = Bars(
            TextColumn("{task.description}"),
            *bar,
            TextColumn("{task.percentage:>3.0f} %  {task.fields[note]}"),
            console=console,
            transient=True,
        )
        self._bar = self._bars.add_task("", total=1.0, note="")

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._bars.stop()

    def show(self, task: TaskInfo, *, paused: bool) -> None:
        """Draw the task's current state."""
        from rich.markup import escape

        work = "" if self._is_narrow else f"{escape(work_of(task))}  "
        self._bars.update(
            self._bar,
            description=f"task {task.task_id}  {work}{task.state}",
            completed=task.progress,
            note="the queue is paused" if paused else f"done in {in_seconds(task.estimated_time)}",
        )


class ChangePrinter:
    """Prints the changes in each update to stdout.

    Args:
        as_json: print one object per line, for every step of progress.
    """

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._shown: dict[int, tuple[object, ...]] = {}
        self._paused = False

    def show(self, update: Update) -> None:
        """Print the changes."""
        if update.paused != self._paused:
            self._paused = update.paused
            self._print_pause()
        for task in update.tasks:
            shown = self._essence(task)
            if self._shown.get(task.task_id) != shown:
                self._shown[task.task_id] = shown
                self._print(
                    json.dumps(as_object(task)) if self._as_json else _timed(status_line(task))
                )
        sys.stdout.flush()

    def _essence(self, task: TaskInfo) -> tuple[object, ...]:
        """Return the facts about a task whose change causes a new line."""
        progress = task.progress if self._as_json else int(task.progress * _STEPS)
        return task.state, task.priority, progress, task.submitted.sec

    def _print_pause(self) -> None:
        text = "the queue is paused" if self._paused else "the queue continues"
        self._print(json.dumps({"paused": self._paused}) if self._as_json else _timed(text))

    @staticmethod
    def _print(line: str) -> None:
        print(line)


def _timed(text: str) -> str:
    return f"{datetime.now():%H:%M:%S}  {text}"
