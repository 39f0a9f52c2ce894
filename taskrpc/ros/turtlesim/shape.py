"""The turtle as polygons, for every view. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from taskrpc.ros.turtlesim.canvas import Color, Point
from taskrpc.ros.turtlesim.world import PIXELS_PER_METRE, Turtle, pixel

_SKIN: Color = (112, 190, 92)
_SHELL: Color = (38, 112, 70)
_PLATE: Color = (74, 150, 88)
_EYE: Color = (20, 34, 28)
_EDGE: Color = (18, 60, 44)


@dataclass(frozen=True)
class Part:
    """One filled polygon, in pixels from the upper left corner of the picture."""

    points: list[Point]
    fill: Color
    edge: Color


def _ellipse(x: float, y: float, wide: float, high: float, corners: int = 20) -> list[Point]:
    angles = [math.tau * number / corners for number in range(corners)]
    return [(x + wide * math.cos(angle), y + high * math.sin(angle)) for angle in angles]


def _leg(x: float, y: float, angle: float) -> list[Point]:
    cosine, sine = math.cos(angle), math.sin(angle)
    outline = _ellipse(0, 0, 0.19, 0.095, 14)
    return [(x + cosine * u - sine * v, y + sine * u + cosine * v) for u, v in outline]


_TAIL = [(-0.33, 0.06), (-0.50, 0.0), (-0.33, -0.06)]
OUTLINES: list[tuple[list[Point], Color, Color]] = [
    (_TAIL, _SKIN, _EDGE),
    *[
        (_leg(x, side * 0.30, side * angle), _SKIN, _EDGE)
        for x, angle in ((0.22, 0.9), (-0.22, 2.25))
        for side in (1, -1)
    ],
    (_ellipse(0.44, 0.0, 0.17, 0.14), _SKIN, _EDGE),
    (_ellipse(0.52, 0.07, 0.03, 0.03, 8), _EYE, _EYE),
    (_ellipse(0.52, -0.07, 0.03, 0.03, 8), _EYE, _EYE),
    (_ellipse(0.0, 0.0, 0.36, 0.31, 28), _SHELL, _EDGE),
    (_ellipse(0.0, 0.0, 0.13, 0.13, 6), _PLATE, _SHELL),
    *[
        (_ellipse(0.225 * math.cos(angle), 0.2 * math.sin(angle), 0.075, 0.065, 6), _PLATE, _SHELL)
        for angle in (math.pi / 6 + math.tau * number / 6 for number in range(6))
    ],
]
"""The polygons of a turtle that looks along the x axis, in metres around the middle of its shell,
from the lowest to the uppermost; each with the colors of its inside and of its edge."""


def parts_of(turtle: Turtle) -> list[Part]:
    """The polygons of a turtle, from the lowest to the uppermost."""
    x, y = pixel(turtle.x, turtle.y)
    cosine, sine = math.cos(turtle.theta), math.sin(turtle.theta)

    def placed(point: Point) -> Point:
        ahead, left = point[0] * PIXELS_PER_METRE, point[1] * PIXELS_PER_METRE
        return x + cosine * ahead - sine * left, y - sine * ahead - cosine * left

    return [Part([placed(point) for point in points], *colors) for points, *colors in OUTLINES]


PARTS = len(OUTLINES)
"""How many polygons a turtle has."""
