"""A map is read as written, and each error shows its line."""

import errno
import os
from pathlib import Path

import pytest

import taskrpc.robot
from taskrpc.robot import KinematicRobot, MapError, Pose, default_world, parse_map, read_map

GOOD = """\
size: [8, 6]
robot_radius: 0.2
walls:
  - [4, 0, 4, 3]
boxes:
  - {at: [5, 4], size: [1, 1]}
places:
  shelf-1: [7, 5]
  küche: [1, 4.5]
dock: [1, 1]
"""


def test_a_map_is_read_as_it_is_written(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text(GOOD, encoding="utf-8")
    world = read_map(path)
    assert world.size == (8.0, 6.0)
    assert world.robot_radius == 0.2
    assert world.places == {"shelf-1": (7.0, 5.0), "küche": (1.0, 4.5), "dock": (1.0, 1.0)}
    assert world.cast(Pose(1, 1, 0), [0.0], 10) == pytest.approx([3.0])
    assert world.cast(Pose(5.5, 2, 1.5707963267948966), [0.0], 10) == pytest.approx([2.0])


def test_a_map_needs_only_a_size_and_a_dock():
    world = parse_map("size: [2, 1]\ndock: [0.5, 0.5]\nwalls:\nboxes: []\nplaces: {}\n")
    assert world.places == {"dock": (0.5, 0.5)}
    assert not world.obstacles


def test_a_map_with_a_byte_order_mark_and_windows_lines_is_read(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_bytes(b"\xef\xbb\xbfsize: [8, 6]\r\ndock: [1, 1]\r\n")
    assert read_map(path).size == (8.0, 6.0)


def test_a_missing_file_and_a_wrong_encoding_are_one_sentence(tmp_path):
    with pytest.raises(MapError) as caught:
        read_map(tmp_path / "none.yaml")
    assert str(caught.value) == (
        f"{tmp_path / 'none.yaml'}: error: cannot read the map: {os.strerror(errno.ENOENT)}"
    )
    (tmp_path / "latin.yaml").write_bytes("size: [8, 6] # Größe".encode("latin-1"))
    with pytest.raises(MapError, match="the map is not UTF-8 text; save it as UTF-8"):
        read_map(tmp_path / "latin.yaml")
    with pytest.raises(MapError, match="cannot read the map"):
        read_map(tmp_path)


# -- the default map -------------------------------------------------------------------------


def test_the_default_map_knows_the_lectures_places():
    world = default_world()
    assert {"warehouse", "station_1", "area_a", "central", "dock"} <= set(world.places)
    assert world.size[0] >= 10
    assert world.size[1] >= 8


def test_the_default_map_is_free_around_every_point_of_the_square():
    world = default_world()
    tenths = [k / 10 for k in range(8, 33)]
    assert all(world.is_free((x, y)) for x in tenths for y in tenths)
    corners = [(0.8, 0.8), (0.8, 3.2), (3.2, 0.8), (3.2, 3.2)]
    assert all(world.path(a, b) == (b,) for a in corners for b in corners)


def test_tasks_on_the_default_map_take_about_as_long_as_the_lectures():
    world = default_world()
    robot = KinematicRobot(world)
    seconds = {
        (a, b): robot.plan("move", b, Pose(*world.places[a], 0.0)).seconds
        for a in world.places
        for b in world.places
        if a != b
    }
    assert all(3.0 < s < 13.0 for s in seconds.values()), seconds


def test_ways_bend_on_the_default_map():
    world = default_world()
    assert len(world.way(world.dock, "warehouse")) > 1
    assert len(world.way(world.dock, "station_1")) > 1


def test_the_default_map_is_a_file_of_the_package():
    assert (Path(taskrpc.robot.__file__).parent / "maps" / "default.yaml").is_file()
