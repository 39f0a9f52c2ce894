"""What the pens have drawn: a picture of pixels that turtles can sense. Pure."""

from __future__ import annotations

from dataclasses import dataclass

SIZE = 500
"""Width and height of the picture [pixel]."""

Color = tuple[int, int, int]
Point = tuple[float, float]

EMPTY: Color = (255, 255, 255)
"""What a turtle senses where nothing is drawn: in ROS 2 the paper is transparent white."""


@dataclass(frozen=True)
class Pen:
    """The pen of a turtle; its line has a width in pixels."""

    color: Color = (179, 184, 255)
    width: int = 3
    down: bool = True


class Canvas:
    """The pixels that pens have covered."""

    def __init__(self) -> None:
        self._pixels: dict[tuple[int, int], Color] = {}
        self._changes: dict[tuple[int, int], Color] = {}
        self._generation = 0

    @property
    def generation(self) -> int:
        """How often the canvas was cleared."""
        return self._generation

    def clear(self) -> None:
        """Remove everything that was drawn."""
        self._pixels.clear()
        self._changes.clear()
        self._generation += 1

    def draw(self, start: Point, end: Point, pen: Pen) -> None:
        """Draw a straight line, if the pen is down."""
        if pen.down:
            self._cover(start, end, pen)

    def take_changes(self) -> dict[tuple[int, int], Color]:
        """The pixels that were drawn since the last call, or since the canvas was cleared."""
        changes, self._changes = self._changes, {}
        return changes

    def color_at(self, point: Point) -> Color:
        """The color of a pixel."""
        return self._pixels.get((round(point[0]), round(point[1])), EMPTY)

    def pixels(self) -> dict[tuple[int, int], Color]:
        """The colors of all pixels that are drawn, by column and row."""
        return self._pixels

    def _cover(self, start: Point, end: Point, pen: Pen) -> None:
        length = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
        steps = max(1, round(length))
        seen = set()
        for step in range(steps + 1):
            share = step / steps
            x = round(start[0] + (end[0] - start[0]) * share)
            y = round(start[1] + (end[1] - start[1]) * share)
            if (x, y) not in seen:
                seen.add((x, y))
                self._stamp(x, y, pen)

    def _stamp(self, x: int, y: int, pen: Pen) -> None:
        """Cover a square of the pen's width around a pixel."""
        before = (pen.width - 1) // 2
        columns = _inside(x - before, pen.width)
        for row in _inside(y - before, pen.width):
            for column in columns:
                self._pixels[column, row] = self._changes[column, row] = pen.color


def _inside(first: int, count: int) -> range:
    return range(max(0, first), min(SIZE, first + count))
