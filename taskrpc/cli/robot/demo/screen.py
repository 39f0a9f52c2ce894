"""The demo's picture on a terminal: clients, queue, robot on its map, events."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console, RenderableType
from rich.layout import Layout
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from taskrpc.cli.robot.demo import map_view
from taskrpc.cli.robot.demo.map_view import FloorPlan, fitting
from taskrpc.cli.robot.demo.story import CLIENTS, Stage
from taskrpc.observe.texts import work_of
from taskrpc.robot.kinematics import Point

SMALLEST = (40, 20)
"""Columns and rows that a picture needs."""

_PERIOD = 1 / 12  # seconds between two pictures
_QUIET = 0.1  # seconds before the end of a task without drawing, see `_is_task_ending`
_TRAIL = 400  # points
_SIDE = 37  # columns beside the map
_WIDE = 76  # columns of a terminal that has room beside the map
_EVENTS = 6  # rows below the map, including borders
_QUEUE = 10  # rows of the queue if it is below the map
_STYLES = {
    map_view.WALL: "blue",
    map_view.PLACE: "yellow",
    map_view.NAME: "yellow",
    map_view.TRAIL: "green",
    map_view.ROBOT: "bold black on bright_green",
    map_view.FLOOR: "",
}
_STATES = {
    "RUNNING": "bold bright_green",
    "SUCCEEDED": "dim green",
    "CANCELED": "dim red",
    "QUEUED": "",
}
_COLOURS = {
    "client_1": "cyan",
    "client_2": "magenta",
    "client_3": "yellow",
    "robot": "bright_green",
}


class Picture:
    """Draws the stage again and again on a terminal.

    Args:
        console: the terminal.
        stage: the clients, tasks and robot to draw.
    """

    def __init__(self, console: Console, stage: Stage) -> None:
        self._console = console
        self._stage = stage
        self._signs = map_view.ASCII if console.options.ascii_only else map_view.UNICODE
        self._trail: deque[Point] = deque(maxlen=_TRAIL)
        self._plan: tuple[tuple[int, int], FloorPlan] | None = None

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the stage on the whole screen while the block runs."""
        live = Live(console=self._console, screen=True, auto_refresh=False)
        with live:
            drawing = asyncio.create_task(self._draw(live))
            try:
                yield
            finally:
                drawing.cancel()

    async def _draw(self, live: Live) -> None:
        while True:
            pose = self._stage.robot.pose()
            self._trail.append((pose.x, pose.y))
            if not self._is_task_ending():
                live.update(self.frame(), refresh=True)
            await asyncio.sleep(_PERIOD)

    def _is_task_ending(self) -> bool:
        """Whether a task is about to end: drawing takes time and would delay its end."""
        robot = self._stage.robot
        return 0.0 < robot.remaining() < _QUIET * robot.speed

    def frame(self) -> Layout:
        """The whole picture, as large as the terminal."""
        columns, rows = self._console.size
        layout = Layout()
        if columns >= _WIDE:
            wide, high = fitting(self._stage.robot.world, columns - _SIDE - 2, rows - _EVENTS - 2)
            side = Layout()
            side.split_column(Layout(self._clients(), size=len(CLIENTS) + 2), Layout(self._queue()))
            top = Layout(size=high + 2)
            top.split_row(Layout(self._map(wide, high), size=wide + 2), side)
            layout.split_column(top, Layout(self._events(rows - high - 4)))
        else:
            wide, high = fitting(self._stage.robot.world, columns - 2, rows - _QUEUE - 5)
            layout.split_column(
                Layout(self._map(wide, high), size=high + 2),
                Layout(self._queue(), size=_QUEUE),
                Layout(self._events(rows - high - 2 - _QUEUE - 2)),
            )
        return layout

    def _map(self, columns: int, rows: int) -> Panel:
        size = columns, rows
        if self._plan is None or self._plan[0] != size:
            self._plan = size, FloorPlan(self._stage.robot.world, *size, self._signs)
        picture = self._plan[1].picture(self._stage.robot.pose(), self._trail)
        text = Text("\n").join(
            Text.assemble(*((cell.text, _STYLES[cell.role]) for cell in row)) for row in picture
        )
        clock = f"{self._stage.now():.0f} s, {self._stage.robot.speed:g} x real time"
        return Panel(text, title="robot", subtitle=clock, padding=0, width=columns + 2)

    def _clients(self) -> Panel:
        lines = [
            Text.assemble((name, _COLOURS[name]), " ", self._stage.requests.get(name, ""))
            for name in CLIENTS
        ]
        return _boxed("three clients", lines)

    def _queue(self) -> Panel:
        table = Table(
            box=None,
            padding=(0, 1),
            collapse_padding=True,
            pad_edge=False,
            expand=True,
            header_style="dim",
        )
        table.add_column("", justify="right", no_wrap=True)
        table.add_column("task", no_wrap=True, overflow="ellipsis")
        table.add_column("prio", justify="right", no_wrap=True)
        table.add_column("done in", justify="right", no_wrap=True)
        for task in self._stage.tasks:
            table.add_row(*_row(task), style=_STATES.get(task.state, ""))
        return Panel(table, title="task server: priority queue", padding=(0, 1))

    def _events(self, rows: int) -> Panel:
        lines = [
            Text.assemble(
                (f"{line.at:5.1f} ", "dim"),
                (f"{line.actor:<9}", _COLOURS.get(line.actor, "")),
                line.text,
            )
            for line in self._stage.lines[-max(1, rows) :]
        ]
        return _boxed("what happens", lines)


def _boxed(title: str, lines: Iterable[Text]) -> Panel:
    content: RenderableType = Text("\n").join(lines)
    assert isinstance(content, Text)
    content.no_wrap, content.overflow = True, "ellipsis"
    return Panel(content, title=title, padding=(0, 1))


def _row(task: Any) -> tuple[str, ...]:
    if task.ended.sec:
        outlook = task.state.lower()
    elif task.started.sec:
        outlook = f"{task.progress:4.0%} {task.estimated_time:4.1f} s"
    else:
        outlook = f"{task.estimated_time:4.1f} s"
    return str(task.task_id), work_of(task), str(task.priority), outlook
