"""The window of turtlesim; needs tkinter and a display."""

import os
import sys

import pytest

pytest.importorskip("tkinter")
if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    pytest.skip("there is no display", allow_module_level=True)

from taskrpc.turtlesim.window import Window
from taskrpc.turtlesim.world import CENTRE, World

pytestmark = pytest.mark.real_time


def test_the_window_shows_turtles_and_ends_when_the_user_closes_it():
    world, window = World(), Window()
    world.spawn("turtle1", CENTRE, CENTRE, 0.0)
    assert window.show(world, (69, 86, 255))
    world.turtles.clear()
    world.canvas.clear()
    assert window.show(world, (69, 86, 255))
    window._mark_closed()
    assert not window.show(world, (69, 86, 255))
    window.close()
