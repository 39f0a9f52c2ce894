"""Lines of pens, and the colors below turtles."""

from hypothesis import example, given
from hypothesis import strategies as st

from taskrpc.ros.turtlesim.canvas import EMPTY, SIZE, Canvas, Pen

RED = (255, 0, 0)
POINTS = st.tuples(*[st.floats(-2 * SIZE, 2 * SIZE)] * 2)


def test_a_line_covers_its_pixels_with_the_width_of_the_pen():
    canvas = Canvas()
    canvas.draw((10, 20), (30, 20), Pen(RED, 3))
    colors = [canvas.color_at((20, y)) for y in range(18, 23)]
    assert colors == [EMPTY, RED, RED, RED, EMPTY]
    assert canvas.color_at((40, 20)) == EMPTY


def test_a_pen_that_is_up_draws_nothing():
    canvas = Canvas()
    canvas.draw((10, 20), (30, 20), Pen(RED, 3, down=False))
    assert canvas.pixels() == {}


def test_changes_are_the_pixels_since_the_last_call():
    canvas = Canvas()
    canvas.draw((10, 20), (30, 20), Pen(RED, 1))
    assert canvas.take_changes() == dict.fromkeys([(x, 20) for x in range(10, 31)], RED)
    canvas.draw((30, 20), (31, 20), Pen(RED, 1))
    assert canvas.take_changes() == {(30, 20): RED, (31, 20): RED}
    assert canvas.take_changes() == {}


def test_clear_removes_pixels_and_changes_the_generation():
    canvas = Canvas()
    canvas.draw((10, 20), (30, 20), Pen())
    before = canvas.generation
    canvas.clear()
    assert (canvas.take_changes(), canvas.pixels()) == ({}, {})
    assert canvas.generation != before


@given(POINTS, POINTS, st.integers(1, 20))
def test_pixels_are_inside_and_cover_the_ends_that_are_inside(start, end, width):
    canvas = Canvas()
    canvas.draw(start, end, Pen(RED, width))
    assert all(0 <= x < SIZE and 0 <= y < SIZE for x, y in canvas.pixels())
    for x, y in (start, end):
        if 0 <= round(x) < SIZE and 0 <= round(y) < SIZE:
            assert canvas.color_at((x, y)) == RED


def test_a_line_from_very_far_is_drawn_where_it_crosses_the_picture():
    canvas = Canvas()
    canvas.draw((-1e9, 20), (1e9, 20), Pen(RED, 1))
    assert set(canvas.pixels()) == {(x, 20) for x in range(SIZE)}
    canvas.clear()
    canvas.draw((1e9, 0), (1e9, 1e9), Pen(RED, 1))
    canvas.draw((-300, 100), (100, -300), Pen(RED, 1))
    assert canvas.pixels() == {}


VERY_FAR = st.tuples(*[st.floats(-4e39, 4e39)] * 2)


@given(POINTS | VERY_FAR, POINTS | VERY_FAR)
@example((6.25e15, -123.7), (-761.6, 321.0))
@example((3.4e39, 2.4e21), (-3e23, 431.4))
def test_a_line_of_any_length_is_drawn_quickly(start, end):
    canvas = Canvas()
    canvas.draw(start, end, Pen(RED, 1))
    assert len(canvas.pixels()) <= 2 * SIZE
