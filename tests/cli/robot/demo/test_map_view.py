"""The map of the demo as text."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.cli.robot.demo.map_view import ASCII, ROBOT, TRAIL, UNICODE, WALL, FloorPlan, fitting
from taskrpc.robot import Box, Pose, World, default_world

WORLD = default_world()


@given(
    st.floats(0, 10), st.floats(0, 8), st.floats(-math.pi, math.pi), st.integers(5, 120),
    st.sampled_from([UNICODE, ASCII]),
)  # fmt: skip
def test_picture_has_the_requested_size_and_one_robot(x, y, theta, columns, signs):
    columns, rows = fitting(WORLD, columns, 60)
    picture = FloorPlan(WORLD, columns, rows, signs).picture(Pose(x, y, theta), [(y, x)])
    assert len(picture) == rows
    assert all(len(row) == columns and all(len(cell.text) == 1 for cell in row) for row in picture)
    assert sum(cell.role == ROBOT for row in picture for cell in row) == 1


@pytest.mark.parametrize(
    ("degrees", "unicode", "ascii_"),
    [
        (0, "→", ">"),
        (90, "↑", "^"),
        (180, "←", "<"),
        (-180, "←", "<"),
        (-90, "↓", "v"),
        (45, "↗", None),
    ],
)
def test_robot_is_drawn_with_its_heading(degrees, unicode, ascii_):
    pose = Pose(5.0, 4.0, math.radians(degrees))
    for signs, expected in ((UNICODE, unicode), (ASCII, ascii_)):
        picture = FloorPlan(WORLD, 40, 16, signs).picture(pose)
        (found,) = [cell.text for row in picture for cell in row if cell.role == ROBOT]
        assert expected in (None, found)


def test_the_origin_is_in_the_lower_left_corner():
    picture = FloorPlan(WORLD, 40, 16).picture(Pose(0.1, 0.1, 0.0))
    assert picture[15][0].role == ROBOT


def test_walls_and_boxes_are_drawn_at_their_positions():
    world = World(
        (4.0, 2.0),
        dock=(0.5, 0.5),
        obstacles=[Box.wall((2.0, 0.0), (2.0, 2.0)), Box.rectangle((3.0, 1.0), (1.0, 1.0))],
    )
    picture = FloorPlan(world, 8, 2, ASCII).picture(Pose(0.5, 0.5, 0.0))
    walls = ["".join("#" if cell.role == WALL else " " for cell in row) for row in picture]
    assert walls == ["    # ##", "    #   "]


def test_every_place_of_the_default_map_is_named_on_a_terminal_of_eighty_columns():
    picture = FloorPlan(WORLD, 40, 16).picture(Pose(5.0, 3.5, 0.0), [(3.0, 3.0)])
    text = "\n".join("".join(cell.text for cell in row) for row in picture)
    assert all(name in text for name in WORLD.places)
    assert sum(cell.role == TRAIL for row in picture for cell in row) == 1
