"""turtlesim in a terminal."""

import io
import os
import shutil

import pytest

from taskrpc.ros.turtlesim.drawing.terminal import Terminal
from taskrpc.ros.turtlesim.world import CENTRE, World

BLUE = (69, 86, 255)


@pytest.fixture
def size(monkeypatch):
    def set_size(columns, lines):
        known = os.terminal_size((columns, lines))
        monkeypatch.setattr(shutil, "get_terminal_size", lambda: known)

    set_size(80, 30)
    return set_size


@pytest.fixture
def world():
    world = World()
    world.spawn("turtle1", CENTRE, CENTRE, 0.0)
    return world


def written(output):
    text = output.getvalue()
    output.seek(0)
    output.truncate()
    return text


def test_the_first_picture_is_whole_and_a_same_one_writes_nothing(size, world):
    output = io.StringIO()
    terminal = Terminal(output)
    assert terminal.show(world, BLUE)
    assert written(output).count("\u2580") == 25 * 50
    assert terminal.show(world, BLUE)
    assert written(output) == ""


def test_only_characters_that_changed_are_written_again(size, world):
    output = io.StringIO()
    terminal = Terminal(output)
    terminal.show(world, BLUE)
    written(output)
    world.turtles["turtle1"].x += 0.3
    terminal.show(world, BLUE)
    text = written(output)
    assert 0 < text.count("\u2580") < 60
    assert text.startswith("\x1b7")  # the log goes on where its cursor was
    assert text.endswith("\x1b8")


def test_another_size_of_the_terminal_draws_all_again(size, world):
    output = io.StringIO()
    terminal = Terminal(output)
    terminal.show(world, BLUE)
    written(output)
    size(120, 50)
    terminal.show(world, BLUE)
    text = written(output)
    assert "\x1b[2J" in text
    assert text.count("\u2580") == 45 * 90


def test_the_end_restores_scrolling_and_colors(size, world):
    output = io.StringIO()
    terminal = Terminal(output)
    terminal.show(world, BLUE)
    written(output)
    terminal.close()
    assert written(output) == "\x1b[0m\x1b[r\x1b[30;1H\n"
