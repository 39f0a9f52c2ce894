"""The lines of the pens as square tiles, for the web page. Pure.

A tile has a name and one state, so that a page that reads slowly gets only the newest one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby

from taskrpc.ros.turtlesim.canvas import SIZE, Canvas

SIDE = 50
"""Width and height of a tile [pixel]."""

Position = tuple[int, int]
"""The column and the row of a tile."""

EVERY: frozenset[Position] = frozenset(
    (column, row) for column in range(SIZE // SIDE) for row in range(SIZE // SIDE)
)
"""The positions of all tiles."""

Runs = list[tuple[int, tuple[int, int, int] | None]]
"""The pixels of a tile, row by row: how many follow each other, and their color, None for none."""


def touched(pixels: Iterable[tuple[int, int]]) -> set[Position]:
    """Return the tiles that contain these pixels."""
    return {(x // SIDE, y // SIDE) for x, y in pixels}


def runs(canvas: Canvas, tile: Position) -> Runs:
    """Return the pixels of a tile."""
    return [(len(list(same)), color) for color, same in groupby(_colors(canvas, tile))]


def _colors(canvas: Canvas, tile: Position) -> Iterator[tuple[int, int, int] | None]:
    pixels, (left, top) = canvas.pixels(), (tile[0] * SIDE, tile[1] * SIDE)
    for y in range(top, top + SIDE):
        for x in range(left, left + SIDE):
            yield pixels.get((x, y))
