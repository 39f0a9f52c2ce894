"""The picture of the demo on terminals of all kinds."""

from __future__ import annotations

import asyncio
import io

import pytest
from rich.console import Console

from taskrpc.cli.robot.demo.map_view import UNICODE
from taskrpc.cli.robot.demo.screen import SMALLEST, Picture
from taskrpc.cli.robot.demo.story import open_stage, perform
from tests.cli.robot.demo.conftest import on_virtual_time


class Terminal(io.StringIO):
    """A terminal of some encoding."""

    def __init__(self, encoding):
        super().__init__()
        self._encoding = encoding

    encoding = property(lambda self: self._encoding)


def console(columns, rows, encoding="utf-8"):
    return Console(
        file=Terminal(encoding),
        width=columns,
        height=rows,
        force_terminal=True,
        color_system=None,
        legacy_windows=False,
    )


def frame(columns, rows, encoding="utf-8", *, at=24.0):
    """The picture at an instant of the story, as lines."""

    async def main():
        terminal = console(columns, rows, encoding)
        async with open_stage() as stage:
            playing = asyncio.create_task(perform(stage))
            await stage.until(at)
            terminal.print(Picture(terminal, stage).frame())
            playing.cancel()
        return terminal.file.getvalue().splitlines()

    return on_virtual_time(main)


def test_picture_shows_clients_queue_robot_and_events():
    lines = frame(80, 24)
    text = "\n".join(lines)
    assert "client_2 scan central 10 -> task 7" in text
    assert "4 report central    3" in text
    assert "6 scan 2,3          4    canceled" in text
    assert " 21.0 client_1 cancel task 6 -> Task 6 was cancelled" in text
    assert any(arrow in text for arrow in UNICODE.arrows)
    assert "…" not in text


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
@pytest.mark.parametrize("size", [(80, 24), SMALLEST, (76, 20), (75, 50), (200, 60), (300, 21)])
def test_picture_exactly_fills_the_terminal_in_its_encoding(size, encoding):
    columns, rows = size
    lines = frame(columns, rows, encoding)
    assert len(lines) <= rows
    assert all(len(line) <= columns for line in lines)
    "\n".join(lines).encode(encoding)
    assert "move station_1" in "\n".join(lines)


async def test_nothing_is_drawn_just_before_a_task_ends():
    terminal = console(80, 24)
    async with open_stage(speed=20) as stage:
        picture = Picture(terminal, stage)
        drawn = []
        draw = picture.frame
        picture.frame = lambda: (drawn.append(stage.robot.remaining()), draw())[1]
        with picture.shown():
            await perform(stage)
    assert len(drawn) > 20
    assert not [left for left in drawn if 0 < left < 0.1 * stage.robot.speed]
    assert terminal.file.getvalue().count("\x1b[?1049h") == 1
    assert terminal.file.getvalue().rstrip().endswith("\x1b[?1049l")
