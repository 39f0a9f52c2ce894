"""What the pens have drawn: a picture of pixels that turtles can sense. Pure."""

from __future__ import annotations

from dataclasses import dataclass

SIZE = 500
"""Width and height of the picture [pixel]."""

Color = tuple[int, int, int]
Point = tuple[float, float]

EMPTY: Color = (255, 255, 255)
"""The color that a turtle senses where nothing is drawn; as in ROS 2, it is white."""


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
        """The number of times that the canvas was cleared."""
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
        if (part := _visible(start, end, pen.width)) is None:
            return
        (x1, y1), (x2, y2) = part
        steps = max(1, round(max(abs(x2 - x1), abs(y2 - y1))))
        shares = (step / steps for step in range(steps + 1))
        points = ((x1 + (x2 - x1) * share, y1 + (y2 - y1) * share) for share in shares)
        for x, y in dict.fromkeys((round(x), round(y)) for x, y in points):
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


def _visible(start: Point, end: Point, width: int) -> tuple[Point, Point] | None:
    """The part of a line near the picture: a turtle may jump very far. None if there is none."""
    first, last = 0.0, 1.0
    lowest, highest = -width, SIZE + width
    for begin, finish in zip(start, end, strict=True):
        length = finish - begin
        if length == 0:
            if not lowest <= begin <= highest:
                return None
            continue
        enters, leaves = sorted(((lowest - begin) / length, (highest - begin) / length))
        first, last = max(first, enters), min(last, leaves)
    if first > last:
        return None
    (x, y), (wide, high) = start, (end[0] - start[0], end[1] - start[1])
    near = (x + wide * first, y + high * first) if first > 0 else start
    far = (x + wide * last, y + high * last) if last < 1 else end
    # Of a very long line, rounding could move these ends far away from the picture again.
    return _limited(near, lowest, highest), _limited(far, lowest, highest)


def _limited(point: Point, lowest: float, highest: float) -> Point:
    x, y = point
    return min(max(x, lowest), highest), min(max(y, lowest), highest)
