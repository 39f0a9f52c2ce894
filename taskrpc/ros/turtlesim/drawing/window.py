"""The window of turtlesim, with tkinter."""

from __future__ import annotations

import tkinter
from collections.abc import Iterable

from taskrpc.ros.turtlesim.canvas import SIZE, Canvas, Color
from taskrpc.ros.turtlesim.shape import PARTS, parts_of
from taskrpc.ros.turtlesim.world import Turtle, World


class Window:
    """A window with the picture; call `show` again and again, so that it stays responsive."""

    def __init__(self) -> None:
        self._root = tkinter.Tk(className="TurtleSim")
        self._root.title("TurtleSim")
        self._root.resizable(False, False)
        self._root.protocol("WM_DELETE_WINDOW", self._mark_closed)
        self._paper = tkinter.Canvas(self._root, width=SIZE, height=SIZE, highlightthickness=0)
        self._paper.pack()
        self._lines = tkinter.PhotoImage(width=SIZE, height=SIZE)
        self._paper.create_image(0, 0, image=self._lines, anchor="nw")
        self._turtles: dict[str, list[int]] = {}
        self._generation = 0
        self._closed = False

    def show(self, world: World, background: Color, title: str = "") -> bool:
        """Draw the world; return False after the user has closed the window."""
        del title  # as in ROS, the window of every node has the same title
        if self._closed:
            return False
        self._paper.configure(background=_hex(background))
        self._draw_lines(world.canvas)
        for name in [one for one in self._turtles if one not in world.turtles]:
            self._paper.delete(*self._turtles.pop(name))
        for name, turtle in sorted(world.turtles.items()):
            self._draw_turtle(name, turtle)
        self._root.update()
        return not self._closed

    def pressed_keys(self) -> Iterable[str]:
        """Return nothing: turtle_teleop_key reads the keys, as in ROS."""
        return ()

    def close(self) -> None:
        """Close the window."""
        self._root.destroy()

    def _mark_closed(self) -> None:
        self._closed = True

    def _draw_lines(self, canvas: Canvas) -> None:
        if canvas.generation != self._generation:
            self._generation = canvas.generation
            self._lines.blank()
        for (x, y), color in canvas.take_changes().items():
            self._lines.put(_hex(color), to=(x, y))

    def _draw_turtle(self, name: str, turtle: Turtle) -> None:
        if name not in self._turtles:
            items = [self._paper.create_polygon(0, 0, 0, 0, 0, 0) for _ in range(PARTS)]
            self._turtles[name] = items
        for item, part in zip(self._turtles[name], parts_of(turtle), strict=True):
            corners = [coordinate for point in part.points for coordinate in point]
            self._paper.coords(item, *corners)
            self._paper.itemconfigure(item, fill=_hex(part.fill), outline=_hex(part.edge))


def _hex(color: Color) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color)
