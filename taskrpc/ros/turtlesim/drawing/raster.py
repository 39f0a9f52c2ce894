"""The picture in few pixels, for a terminal: two pixels in each character. Pure."""

from __future__ import annotations

from taskrpc.ros.turtlesim.canvas import SIZE, Color, Point
from taskrpc.ros.turtlesim.shape import parts_of
from taskrpc.ros.turtlesim.world import World

Picture = list[list[Color]]


def picture(world: World, background: Color, columns: int, rows: int) -> Picture:
    """Return the rows of a picture of `columns` by `rows` pixels."""
    image = [[background] * columns for _ in range(rows)]
    for (x, y), color in world.canvas.pixels().items():
        image[y * rows // SIZE][x * columns // SIZE] = color
    scale = columns / SIZE, rows / SIZE
    for _, turtle in sorted(world.turtles.items()):
        for part in parts_of(turtle):
            points = [(x * scale[0], y * scale[1]) for x, y in part.points]
            _fill(image, points, part.fill)
    return image


def _fill(image: Picture, points: list[Point], color: Color) -> None:
    """Color the pixels whose center is inside a polygon."""
    ys = [y for _, y in points]
    for row in range(max(0, int(min(ys))), min(len(image), int(max(ys)) + 1)):
        crossings = _crossings(points, row + 0.5)
        for left, right in zip(crossings[::2], crossings[1::2], strict=True):
            for column in range(max(0, round(left)), min(len(image[row]), round(right))):
                image[row][column] = color


def _crossings(points: list[Point], y: float) -> list[float]:
    """Where a horizontal line crosses the edges of a polygon."""
    found = []
    for (x1, y1), (x2, y2) in zip(points, [*points[1:], points[0]], strict=True):
        if (y1 <= y) != (y2 <= y):
            found.append(x1 + (y - y1) / (y2 - y1) * (x2 - x1))
    return sorted(found)


def characters(image: Picture) -> list[list[str]]:
    """The characters of a picture with their colors: each shows two pixels, one above the other."""
    pairs = zip(image[::2], image[1::2], strict=True)
    return [
        [_character(*pixels) for pixels in zip(above, below, strict=True)] for above, below in pairs
    ]


def _character(above: Color, below: Color) -> str:
    front, back = ";".join(map(str, above)), ";".join(map(str, below))
    return f"\x1b[38;2;{front};48;2;{back}m\N{UPPER HALF BLOCK}"
