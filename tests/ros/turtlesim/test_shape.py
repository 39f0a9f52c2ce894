"""The polygons of a turtle."""

import math

import pytest

from taskrpc.ros.turtlesim.shape import PARTS, parts_of
from taskrpc.ros.turtlesim.world import CENTRE, PIXELS_PER_METRE, Turtle, pixel


def corners(theta):
    parts = parts_of(Turtle("turtle1", CENTRE, CENTRE, theta))
    assert len(parts) == PARTS
    return [point for part in parts for point in part.points]


@pytest.mark.parametrize("theta", [0.0, 1.0, -2.5])
def test_a_turtle_is_about_one_metre_long_and_around_its_position(theta):
    middle = pixel(CENTRE, CENTRE)
    distances = [math.dist(point, middle) for point in corners(theta)]
    assert 0.45 < max(distances) / PIXELS_PER_METRE < 0.75


def test_the_head_is_in_the_direction_of_the_heading():
    x, y = pixel(CENTRE, CENTRE)
    points = corners(math.pi / 2)  # up, which is a smaller y in the picture
    assert y - min(at for _, at in points) > max(at for _, at in points) - y
    lefts, rights = x - min(at for at, _ in points), max(at for at, _ in points) - x
    assert lefts == pytest.approx(rights)
