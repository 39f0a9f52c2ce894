"""An obstacle on the map: whether it contains a point, blocks a path, or meets a ray."""

import math
from typing import NamedTuple

from taskrpc.robot.kinematics import Point

_TOUCH = 1e-9  # metres; driving along a wall, or around its corner, is no collision


class Box(NamedTuple):
    """A rectangle at any angle; with zero width it is a wall drawn as a line.

    Its own frame has the origin at its centre and the first axis along (`ux`, `uy`).
    """

    x: float
    """The centre, in metres."""
    y: float
    ux: float
    """The unit vector along the length."""
    uy: float
    half_length: float
    """Metres, as `half_width`."""
    half_width: float

    @classmethod
    def wall(cls, start: Point, end: Point) -> "Box":
        """Return a wall without thickness from `start` to `end`, which must differ."""
        length = math.dist(start, end)
        ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
        middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
        return cls(*middle, ux, uy, length / 2, 0.0)

    @classmethod
    def rectangle(cls, corner: Point, size: Point) -> "Box":
        """Return an upright rectangle from its lower left corner, width and height."""
        half_length, half_width = size[0] / 2, size[1] / 2
        return cls(
            corner[0] + half_length, corner[1] + half_width, 1.0, 0.0, half_length, half_width
        )

    def inflated(self, margin: float) -> "Box":
        """Return the box, larger by `margin` metres on every side.

        The corners stay square. A round robot could pass them more closely, but with square
        corners its shortest path consists of straight lines only.
        """
        return self._replace(
            half_length=self.half_length + margin, half_width=self.half_width + margin
        )

    def corners(self) -> list[Point]:
        """Return the four corners, counterclockwise."""
        return [
            (
                self.x + a * self.half_length * self.ux - b * self.half_width * self.uy,
                self.y + a * self.half_length * self.uy + b * self.half_width * self.ux,
            )
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]

    def contains(self, point: Point) -> bool:
        """Return whether the point lies inside; the edge counts as outside."""
        u, v = self._local(point)
        return abs(u) < self.half_length - _TOUCH and abs(v) < self.half_width - _TOUCH

    def blocks(self, start: Point, end: Point) -> bool:
        """Return whether the line from `start` to `end` passes through the inside."""
        u0, v0 = self._local(start)
        u1, v1 = self._local(end)
        length, width = self.half_length - _TOUCH, self.half_width - _TOUCH
        enter_u, leave_u = _slab(u0, u1 - u0, length)
        enter_v, leave_v = _slab(v0, v1 - v0, width)
        return max(enter_u, enter_v, 0.0) < min(leave_u, leave_v, 1.0)

    def ray(self, origin: Point, direction: Point) -> float:
        """Return the distance of a ray to the box, in lengths of `direction`; inf if it misses."""
        u, v = self._local(origin)
        du = direction[0] * self.ux + direction[1] * self.uy
        dv = direction[1] * self.ux - direction[0] * self.uy
        enter_u, leave_u = _slab(u, du, self.half_length)
        enter_v, leave_v = _slab(v, dv, self.half_width)
        enter, leave = max(enter_u, enter_v, 0.0), min(leave_u, leave_v)
        return enter if enter <= leave else math.inf

    def _local(self, point: Point) -> Point:
        dx, dy = point[0] - self.x, point[1] - self.y
        return dx * self.ux + dy * self.uy, dy * self.ux - dx * self.uy


def _slab(start: float, slope: float, half: float) -> Point:
    """Return when a moving coordinate enters and leaves [-half, half]; (inf, -inf) if never."""
    if slope == 0.0:
        return (-math.inf, math.inf) if abs(start) <= half else (math.inf, -math.inf)
    a, b = (-half - start) / slope, (half - start) / slope
    return (a, b) if a < b else (b, a)
