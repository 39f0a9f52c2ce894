"""The terminal is restored after an error, and log lines stay off the picture."""

from __future__ import annotations

import io
import logging

import pytest
from rich.console import Console

from taskrpc.cli.observe.top import screen
from tests.cli.observe.top.test_picture import BUSY, text


def console(file, **settings):
    return Console(
        file=file, width=80, height=24, force_terminal=True, legacy_windows=False, **settings
    )


async def shown(read, monkeypatch, **settings):
    monkeypatch.setattr(screen.terminal, "keys_pressed", lambda pressed: _Pressed(pressed))
    file = io.StringIO()
    await screen.show(console(file, **settings), read, 1.0)
    return file.getvalue()


class _Pressed:
    """Presses q after the first picture."""

    def __init__(self, pressed):
        self._pressed = pressed

    def __enter__(self):
        import asyncio

        asyncio.get_running_loop().call_later(0.5, self._pressed, "x")
        asyncio.get_running_loop().call_later(2.5, self._pressed, "q")

    def __exit__(self, *exc_info):
        return None


async def test_pictures_are_drawn_until_q_is_pressed(monkeypatch):
    drawn = []

    async def read():
        drawn.append(1)
        return BUSY

    out = await shown(read, monkeypatch, color_system="standard")
    assert len(drawn) == 3  # at 0, 1 and 2 seconds
    assert out.count("/add_two_ints") == 3
    assert "\x1b[1;31m" in out  # errors are red


async def test_without_colours_all_is_said_in_text(monkeypatch):
    async def read():
        return BUSY

    monkeypatch.setenv("NO_COLOR", "1")
    out = await shown(read, monkeypatch)
    assert "\x1b[1;31m" not in out
    assert "✕ 2 errors" in out


async def test_the_terminal_is_restored_after_an_error(monkeypatch):
    async def read():
        raise RuntimeError("a defect")

    file = io.StringIO()
    monkeypatch.setattr(screen.terminal, "keys_pressed", lambda pressed: _Pressed(pressed))
    with pytest.raises(RuntimeError, match="a defect"):
        await screen.show(console(file), read, 1.0)
    assert file.getvalue().endswith("\x1b[?25h\x1b[?1049l")


async def test_log_lines_stay_off_the_picture(monkeypatch, capsys):
    async def read():
        logging.getLogger("taskrpc.transport").warning("a peer does not answer")
        return BUSY

    await shown(read, monkeypatch)
    assert capsys.readouterr().err == ""


def test_styled_lines_have_the_text_of_the_picture():
    lines = screen.picture(BUSY, 80, 24)
    shown_lines = [line.rstrip() for line in screen.styled(lines).plain.split("\n")]
    assert shown_lines == text(BUSY, 80, 24)
