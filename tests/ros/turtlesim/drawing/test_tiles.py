"""The tiles of the picture that the web page gets."""

from hypothesis import given, settings
from hypothesis import strategies as st

from taskrpc.ros.turtlesim.canvas import SIZE, Canvas, Pen
from taskrpc.ros.turtlesim.drawing.tiles import EVERY, SIDE, runs, touched

POINTS = st.tuples(st.floats(-20, 130), st.floats(SIZE - 130, SIZE + 20))
PENS = st.builds(Pen, st.sampled_from([(1, 2, 3), (255, 0, 0)]), st.integers(1, 12))


def pixels_of(tile, found):
    """The pixels of a tile from its runs."""
    colors = [color for count, color in found for _ in range(count)]
    assert len(colors) == SIDE * SIDE
    left, top = tile[0] * SIDE, tile[1] * SIDE
    return {
        (left + number % SIDE, top + number // SIDE): color
        for number, color in enumerate(colors)
        if color is not None
    }


@settings(max_examples=30)
@given(st.lists(st.tuples(POINTS, POINTS, PENS), max_size=2))
def test_touched_tiles_contain_all_pixels_that_pens_have_drawn(lines):
    canvas = Canvas()
    for start, end, pen in lines:
        canvas.draw(start, end, pen)
    found = {}
    for tile in touched(canvas.take_changes()):
        assert tile in EVERY
        found |= pixels_of(tile, runs(canvas, tile))
    assert found == canvas.pixels()


def test_empty_tile_is_one_run_without_color():
    assert runs(Canvas(), (0, 0)) == [(SIDE * SIDE, None)]


def test_tiles_cover_the_whole_picture():
    assert touched((x, y) for x in range(SIZE) for y in range(SIZE)) == EVERY
