"""Reads what `view()` shows, and draws it again while the robot works."""

from __future__ import annotations

import asyncio
import math
import os
import time
from collections.abc import Callable

import taskrpc.sync
from taskrpc import Observer
from taskrpc.course.notebook.calls import CallList
from taskrpc.course.notebook.jupyter import Picture
from taskrpc.course.notebook.picture import Shown, html, text
from taskrpc.observe.top.model import TaskServerRow
from taskrpc.observe.top.reading import TaskServerReader, task_services
from taskrpc.robot.kinematics import Point
from taskrpc.robot.world import World

PERIOD = 0.25
"""Seconds between two pictures."""
_TIMEOUT = 2.0  # seconds that a task server gets to answer
_FIRST_POSE = 0.2  # seconds until a task server has sent its first pose
_SLICE = 0.1  # seconds; Windows notices Ctrl-C only between two sleeps
_LONGEST_TRAIL = 200  # points
_SHORTEST_STEP = 0.05  # metres between two points of the trail


class View:
    """A picture below a cell that follows the robot, the queue and the calls.

    Args:
        picture: draws.
        calls: the calls of this notebook.
        world: returns the map.
    """

    def __init__(self, picture: Picture, calls: CallList, world: Callable[[], World]) -> None:
        self._picture = picture
        self._calls = calls
        self._world = world
        # An observer of its own, so that the notebook does not take it for a node of a cell.
        name = f"_taskrpc_view_{os.getpid()}_{id(self):x}"
        self._node = taskrpc.sync.Node(name, observer=Observer())
        self._reader: TaskServerReader | None = None
        self._service = ""
        self._trail: list[Point] = []
        self._drawn: Shown | None = None
        self._following: asyncio.Future[None] | None = None
        self._is_over = False

    def draw_once(self) -> None:
        """Draw the present state."""
        self._node.start()
        self._node.loop_thread.run(self._draw(), "view()")

    def follow(self) -> None:
        """Draw each change from now on, until `stop`; does not wait."""
        loop = self._node.loop_thread
        loop.soon(self._begin)

    def follow_for(self, seconds: float) -> None:
        """Draw each change for some seconds; waits, and Ctrl-C ends it."""
        self.follow()
        end = time.monotonic() + seconds
        try:
            while (left := end - time.monotonic()) > 0:
                time.sleep(min(_SLICE, left))
        finally:
            self.stop()

    def stop(self) -> None:
        """Draw no more; the last picture stays."""
        if not self._is_over:
            self._is_over = True
            self._node.loop_thread.do(self._end, "stop()")
            self._node.close()

    def _begin(self) -> None:
        if not self._is_over:
            self._following = asyncio.ensure_future(self._follow())

    def _end(self) -> None:
        if self._following is not None:
            self._following.cancel()

    async def _follow(self) -> None:
        while True:
            await asyncio.sleep(PERIOD)
            await self._draw()

    async def _draw(self) -> None:
        shown = Shown(
            self._world(), await self._server(), tuple(self._trail), tuple(self._calls.newest())
        )
        if shown != self._drawn:
            self._drawn = shown
            self._picture.show(html(shown), text(shown))

    async def _server(self) -> TaskServerRow | None:
        """Read the first task server that can be seen; None if there is none."""
        node = self._node.async_node
        found = task_services(await node.graph())
        if self._service not in found or self._reader is None:
            if self._reader is not None:
                self._reader.close()
                self._reader = None
            self._trail.clear()
            self._service = found[0] if found else ""
            if not found:
                return None
            self._reader = TaskServerReader(node, self._service, _TIMEOUT)
            await asyncio.sleep(_FIRST_POSE)
        row = await self._reader.read()
        if row.pose is not None:
            self._went_to((row.pose.x, row.pose.y))
        return row

    def _went_to(self, point: Point) -> None:
        if not self._trail or _distance(self._trail[-1], point) >= _SHORTEST_STEP:
            self._trail.append(point)
            del self._trail[:-_LONGEST_TRAIL]


def _distance(a: Point, b: Point) -> float:
    return math.dist(a, b)
