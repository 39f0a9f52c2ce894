"""A robot's map drawn with characters: walls, named places, the robot and its trail.

With half blocks, a character shows two square dots, one above the other. On a terminal with only
ASCII, one character stands for both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from taskrpc.robot import Box, Pose, World
from taskrpc.robot.kinematics import Point

WALL, PLACE, NAME, TRAIL, ROBOT, FLOOR = "wall", "place", "name", "trail", "robot", "floor"
"""The roles of a cell, from which a view chooses its colour."""


class Cell(NamedTuple):
    """One character of the picture."""

    text: str
    role: str


class Signs(NamedTuple):
    """The characters of a picture."""

    blocks: str
    """For no dot, the lower dot, the upper dot, both dots."""
    place: str
    trail: str
    arrows: str
    """The robot by its heading, counterclockwise from the x axis."""


UNICODE = Signs(" ▄▀█", "◆", "·", "→↗↑↖←↙↓↘")
ASCII = Signs(" ###", "o", ".", ">^<v")

_NEAR = 3  # rows at most between a place and its name
_BLANK = Cell(" ", FLOOR)


def fitting(world: World, columns: int, rows: int) -> tuple[int, int]:
    """Return the largest size with the map's proportions; a character is twice as high as wide."""
    width, height = world.size
    scale = min(columns / width, 2 * rows / height)
    return max(1, math.floor(scale * width)), max(1, round(scale * height / 2))


class FloorPlan:
    """Draws one map at one size.

    Args:
        world: the map.
        columns, rows: the picture's size in characters.
        signs: the characters to draw with.
    """

    def __init__(self, world: World, columns: int, rows: int, signs: Signs = UNICODE) -> None:
        self._columns, self._rows = columns, rows
        self._signs = signs
        self._scale = columns / world.size[0], rows / world.size[1]
        dots = {dot for box in world.obstacles for dot in self._dots(box)}
        self._floor = [[self._block(dots, x, y) for x in range(columns)] for y in range(rows)]
        for place in world.places.values():
            self._put(self._floor, place, Cell(signs.place, PLACE))
        for name, place in world.places.items():
            self._label(name, place)

    def picture(self, pose: Pose, trail: Iterable[Point] = ()) -> list[list[Cell]]:
        """Return the map with the robot and its trail, as rows from the top."""
        cells = [row.copy() for row in self._floor]
        for point in trail:
            x, y = self._cell(point)
            if cells[y][x].role == FLOOR:
                cells[y][x] = Cell(self._signs.trail, TRAIL)
        arrows = self._signs.arrows
        turn = round(pose.theta / math.tau * len(arrows)) % len(arrows)
        self._put(cells, (pose.x, pose.y), Cell(arrows[turn], ROBOT))
        return cells

    def _cell(self, point: Point) -> tuple[int, int]:
        """Return the column and the row of a point, rows counted from the top."""
        x = min(max(int(point[0] * self._scale[0]), 0), self._columns - 1)
        y = min(max(int(point[1] * self._scale[1]), 0), self._rows - 1)
        return x, self._rows - 1 - y

    def _dots(self, box: Box) -> Iterable[tuple[int, int]]:
        """Return the dots that a box covers: column and half row, rows counted from the bottom."""
        step = 0.5 / max(self._scale[0], 2 * self._scale[1])
        for u in _samples(box.half_length, step):
            for v in _samples(box.half_width, step):
                x = box.x + u * box.ux - v * box.uy
                y = box.y + u * box.uy + v * box.ux
                yield int(x * self._scale[0]), int(2 * y * self._scale[1])

    def _block(self, dots: set[tuple[int, int]], x: int, y: int) -> Cell:
        lower = 2 * (self._rows - 1 - y)
        kind = ((x, lower) in dots) + 2 * ((x, lower + 1) in dots)
        return Cell(self._signs.blocks[kind], WALL) if kind else _BLANK

    def _put(self, cells: list[list[Cell]], point: Point, cell: Cell) -> None:
        x, y = self._cell(point)
        cells[y][x] = cell

    def _label(self, name: str, place: Point) -> None:
        """Write a name near its place, if there is room."""
        x, y = self._cell(place)
        middle = x - len(name) // 2
        rows = range(y - _NEAR, y + _NEAR + 1)
        lefts = range(middle - len(name), middle + len(name) + 1)
        spots = ((row, left) for row in rows for left in lefts)
        nearest = sorted(spots, key=lambda spot: 2 * abs(spot[0] - y) + abs(spot[1] - middle))
        for row, left in nearest:
            if self._is_blank(left, row, len(name)):
                self._floor[row][left : left + len(name)] = [Cell(c, NAME) for c in name]
                return

    def _is_blank(self, left: int, row: int, length: int) -> bool:
        if not (0 <= row < self._rows and left >= 0 and left + length <= self._columns):
            return False
        return all(cell is _BLANK for cell in self._floor[row][left : left + length])


def _samples(half: float, step: float) -> Sequence[float]:
    """Return points from -half to half; slightly inside, so that no end falls on the next dot."""
    count = max(1, math.ceil(2 * half / step))
    return [0.0] if not half else [(2 * i / count - 1) * half * 0.999 for i in range(count + 1)]
