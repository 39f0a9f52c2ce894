"""Chooses where turtlesim draws: a window, a web page, the terminal, or nowhere."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from taskrpc.errors import TaskRpcError
from taskrpc.ros.turtlesim.canvas import Color
from taskrpc.ros.turtlesim.world import World

if TYPE_CHECKING:
    from taskrpc.ros.turtlesim.drawing.web_view import WebView

NAMES = ("auto", "window", "page", "terminal", "none")
_INTERVAL = 1 / 30
"""Time between two pictures [s]."""


class View(Protocol):
    """A place for the picture."""

    def show(self, world: World, background: Color, title: str) -> bool:
        """Draw the world now; return False after the user has closed the view."""

    def pressed_keys(self) -> Iterable[str]:
        """Return the keys for teleop that the user has pressed in the view since the last call."""

    def close(self) -> None:
        """Remove the picture."""


class PacedView:
    """Draws into a view at most 30 times a second, even if the program calls it more often.

    Args:
        view: where to draw; None draws nowhere.
        hint: printed at the first picture, so that it is below the first log lines.
    """

    def __init__(self, view: View | None, hint: str = "") -> None:
        self.title = "turtlesim"
        """The name of the picture: that of the node."""
        self._view, self._hint = view, hint
        self._next = 0.0

    def draw(self, world: World, background: Color) -> bool:
        """Draw if it is time; return False after the user has closed the view."""
        if self._hint:
            print(self._hint, file=sys.stderr)
            self._hint = ""
        if self._view is None or (now := time.monotonic()) < self._next:
            return True
        self._next = now + _INTERVAL
        return self._view.show(world, background, self.title)

    def pressed_keys(self) -> Iterable[str]:
        """Return the keys for teleop that the user has pressed in the view since the last call."""
        return () if self._view is None else self._view.pressed_keys()


@contextmanager
def opened(name: str, port: int | None = None) -> Iterator[PacedView]:
    """Open the view of this name; `auto` takes the first that works.

    Args:
        name: one of `NAMES`.
        port: the port of the web page; None for the usual one or, if it is not free, any other.

    Raises TaskRpcError if the view does not work on this computer; `auto` always works.
    """
    view, hint = _view(name, port)
    try:
        yield PacedView(view, hint)
    finally:
        if view is not None:
            view.close()


_HOW = (
    "No display and no terminal was found, so turtles are not drawn. To see them in a browser:"
    " pip install aiohttp. To see the pose of one: taskrpc topic echo /turtle1/pose"
)


def _view(name: str, port: int | None) -> tuple[View | None, str]:
    """Return the view of this name, and a hint for the user."""
    if name == "none":
        return None, ""
    if name in ("auto", "window"):
        problem = _no_window()
        if not problem:
            from taskrpc.ros.turtlesim.drawing.window import Window  # tkinter may be missing

            return Window(), ""
        if name == "window":
            raise TaskRpcError(f"cannot open a window: {problem}; try --view page")
    if name in ("auto", "page"):
        try:
            page = _page(port)
        except TaskRpcError:
            if name == "page":
                raise
        else:
            return page, f"turtlesim draws on a web page of this computer: {page.url}"
    if sys.stdout.isatty():
        from taskrpc.ros.turtlesim.drawing.terminal import Terminal

        return Terminal(sys.stdout), ""
    if name == "terminal":
        raise TaskRpcError("cannot draw: expected a terminal as the output, got a file or a pipe")
    return None, _HOW


def _page(port: int | None) -> WebView:
    """Serve the web page. Raises TaskRpcError."""
    try:
        from taskrpc.ros.turtlesim.drawing.web_view import WebView
    except ModuleNotFoundError as error:
        if error.name and error.name.startswith("taskrpc"):
            raise
        raise TaskRpcError(f"--view page needs {error.name}: pip install aiohttp") from None
    return WebView(port)


def _no_window() -> str:
    """Why no window can be opened; "" if it can."""
    needs_display = sys.platform not in {"win32", "darwin"}
    if needs_display and not os.environ.get("DISPLAY"):
        return "expected a display, but the variable DISPLAY is not set"
    try:
        import tkinter
    except ImportError:
        return "this Python has no tkinter; on Debian, install it with apt-get install python3-tk"
    try:
        tkinter.Tk().destroy()
    except tkinter.TclError as error:
        return str(error)
    return ""
