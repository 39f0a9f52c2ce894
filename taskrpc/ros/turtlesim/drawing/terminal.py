"""turtlesim in a terminal: the picture above, the program's log lines below."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from typing import TextIO

from taskrpc.ros.turtlesim.canvas import Color
from taskrpc.ros.turtlesim.drawing.raster import characters, picture
from taskrpc.ros.turtlesim.world import World

_LOG_ROWS = 5
"""Rows below the picture in which log lines scroll."""
_SMALLEST = 10
_SAVE, _RESTORE, _RESET = "\x1b7", "\x1b8", "\x1b[0m"


class Terminal:
    """Draws into a terminal and rewrites only characters that changed, so it does not flicker.

    Args:
        output: the terminal.
    """

    def __init__(self, output: TextIO) -> None:
        self._output = output
        self._size: tuple[int, int] = (0, 0)
        self._shown: list[list[str]] = []
        self._prepare()

    def show(self, world: World, background: Color, title: str = "") -> bool:
        """Draw the world; always returns True, because Ctrl-C ends the program."""
        del title  # the log lines below the picture name the node
        rows = self._prepare()
        text = self._changes(characters(picture(world, background, 2 * rows, 2 * rows)))
        if text:
            self._output.write(f"{_SAVE}{text}{_RESET}{_RESTORE}")
            self._output.flush()
        return True

    def pressed_keys(self) -> Iterable[str]:
        """Return nothing: turtle_teleop_key reads the keys, as in ROS."""
        return ()

    def close(self) -> None:
        """Give the whole terminal back, with the cursor below the picture."""
        self._output.write(f"{_RESET}\x1b[r\x1b[{self._size[1]};1H\n")
        self._output.flush()

    def _prepare(self) -> int:
        """Clear the terminal if its size has changed, and let log lines scroll below the picture.

        Returns the number of rows of the picture.
        """
        columns, lines = size = shutil.get_terminal_size()
        rows = max(_SMALLEST, min(lines - _LOG_ROWS, columns // 2))
        if size != self._size:
            self._size, self._shown = size, []
            below = f"\x1b[{rows + 1};{lines}r\x1b[{rows + 1};1H"
            self._output.write(f"{_RESET}\x1b[r\x1b[2J{below}")
            self._output.flush()
        return rows

    def _changes(self, image: list[list[str]]) -> str:
        before = self._shown or [[""] * len(row) for row in image]
        self._shown = image
        text = []
        for number, (row, old) in enumerate(zip(image, before, strict=True), start=1):
            end = 0  # the column behind the last written character
            for column, (new, was) in enumerate(zip(row, old, strict=True), start=1):
                if new != was:
                    text.append(new if column == end else f"\x1b[{number};{column}H{new}")
                    end = column + 1
        return "".join(text)
