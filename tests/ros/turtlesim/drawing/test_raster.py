"""The picture for terminals."""

from taskrpc.ros.turtlesim.drawing.raster import characters, picture
from taskrpc.ros.turtlesim.world import CENTRE, World

BLUE = (69, 86, 255)


def test_an_empty_world_is_its_background():
    assert picture(World(), BLUE, 3, 2) == [[BLUE] * 3] * 2


def test_lines_and_turtles_are_in_the_picture_at_their_places():
    world = World()
    world.canvas.draw((0, 0), (499, 0), world.spawn("turtle1", CENTRE, CENTRE, 0.0).pen)
    image = picture(world, BLUE, 50, 50)
    assert set(image[0]) == {(179, 184, 255)}
    assert image[24][25] not in (BLUE, (179, 184, 255))
    assert image[-1] == [BLUE] * 50


def test_a_turtle_at_the_edge_is_cut_off():
    world = World()
    world.spawn("turtle1", 0.0, 0.0, 0.0)
    image = picture(world, BLUE, 50, 50)
    assert image[-1][0] != BLUE
    assert {len(row) for row in image} == {50}


def test_a_character_shows_two_pixels():
    red, green = (255, 0, 0), (0, 255, 0)
    assert characters([[red], [green]]) == [["\x1b[38;2;255;0;0;48;2;0;255;0m\u2580"]]
