"""The window of turtlesim; needs tkinter, and a display or the program Xvfb, which imitates one."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("tkinter")

from taskrpc.ros.turtlesim.drawing.window import Window
from taskrpc.ros.turtlesim.world import CENTRE, World
from tests.javascript.packages import program

pytestmark = [pytest.mark.browser, pytest.mark.real_time]

BLUE = (69, 86, 255)


@pytest.fixture
def display(monkeypatch):
    """A display: that of the computer, else one of Xvfb."""
    if sys.platform != "linux" or os.environ.get("DISPLAY"):
        yield
        return
    command = [program("Xvfb", package="xvfb"), "-displayfd", "1", "-nolisten", "tcp"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        monkeypatch.setenv("DISPLAY", f":{process.stdout.readline().decode().strip()}")
        yield
        process.terminate()


def test_the_window_shows_turtles_and_lines_and_ends_when_the_user_closes_it(display):
    world, window = World(), Window()
    turtle = world.spawn("turtle1", CENTRE, CENTRE, 0.0)
    assert window.show(world, BLUE)
    assert (window._root.winfo_width(), window._root.winfo_height()) == (500, 500)
    turtle.command(5.0, 0.0, 0.0, 0.0)
    for _ in range(10):
        world.step(0.0)
    assert window.show(world, BLUE)
    assert window._lines.get(260, 250) == (179, 184, 255)
    assert window._paper.cget("background") == "#4556ff"
    assert len(window._paper.find_all()) == 1 + len(window._turtles["turtle1"])
    world.turtles.clear()
    world.canvas.clear()
    assert window.show(world, BLUE)
    assert len(window._paper.find_all()) == 1
    assert window._lines.transparency_get(260, 250)
    window._mark_closed()
    assert not window.show(world, BLUE)
    window.close()
