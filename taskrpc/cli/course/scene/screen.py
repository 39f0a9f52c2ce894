"""The lines of a scene for a projector: at most 25 for one program, and short; pure."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

import msgspec

from taskrpc.course.scenes.moments import NETWORK, PROGRAM, ROBOT, SIMULATOR, TASKRPC, Moment
from taskrpc.course.scenes.scene import Line, Scene

MOST_COLUMNS = 88
"""Columns of the text, also on a wider terminal: a class reads short lines."""
_MOMENT_LINES = 3
"""Most lines of one thing that happens; a program that runs alone prints all of an explanation."""
_CAUSE_LINES = 4
"""Most lines of the cause of a longer explanation; the advice behind the cause is left out."""
_CONTINUED = 4
"""Columns by which the rest of a long line of a program stands to the right of its beginning."""
_LABEL = 10
"""Columns of the labels at the left."""

_BOLD, _DIM, _MARKED = "1", "2", "1;33"
_COLOURS = {PROGRAM: "36", NETWORK: "35", ROBOT: "32", TASKRPC: "33", SIMULATOR: "35"}


class Screen(msgspec.Struct, frozen=True):
    """Lays out the parts of a scene as lines.

    Attributes:
        columns: the width of the terminal.
        coloured: whether the lines have colours.
    """

    columns: int = 80
    coloured: bool = False

    def title(self, scene: Scene, *, cure: bool, like_ros: bool) -> list[str]:
        """Return the title of a scene, and whether this is the cure."""
        which = ", the cure" if cure else ", like ROS 2" if like_ros else ""
        return [self._in(_BOLD, f"{scene.title}") + self._in(_DIM, f"  ({scene.name}{which})"), ""]

    def code(self, lines: Sequence[Line]) -> list[str]:
        """Return lines of a program with their numbers; a mark points at some of them."""
        return [*(part for each in lines for part in self._code(each)), ""]

    def _code(self, line: Line) -> Iterator[str]:
        head = f"{'>' if line.is_marked else ' '} {line.number:>3}  "
        margin = " " * (len(line.text) - len(line.text.lstrip()) + _CONTINUED)
        width = max(20, self.columns - len(head))
        texts = textwrap.wrap(line.text, width, subsequent_indent=margin, break_on_hyphens=False)
        for number, text in enumerate(texts or [""]):
            shown = f"{head if number == 0 else ' ' * len(head)}{text}".rstrip()
            yield self._in(_MARKED, shown) if line.is_marked else shown

    def moment(self, moment: Moment) -> list[str]:
        """Return the lines of one thing that happens."""
        actor = self._in(_COLOURS.get(moment.actor, ""), f"{moment.actor:<8}")
        label = f"{moment.at:4.1f} s  {actor} "
        first, *others = self._shortened(moment.text, len("99.9 s  program  "))
        return [label + first, *(" " * 17 + text for text in others)]

    def _shortened(self, text: str, indent: int) -> list[str]:
        """Return a text on a few lines; of a long one, only the part before the semicolon."""
        lines = self._wrapped(text, indent)
        if len(lines) <= _MOMENT_LINES:
            return lines
        cause, separator, _ = text.partition("; ")
        lines = self._wrapped(f"{cause} …" if separator else text, indent)
        if len(lines) <= _CAUSE_LINES:
            return lines
        return [*lines[: _CAUSE_LINES - 1], f"{lines[_CAUSE_LINES - 1]} …"]

    def explanation(self, scene: Scene, *, cure: bool, like_ros: bool) -> list[str]:
        """Return what the class has seen and why; for a cure, what to do."""
        if cure:
            return ["", *self._labelled("Cure", scene.cure)]
        sees = [("You see", scene.ros)] if like_ros else [("You see", scene.sees)]
        other = [] if like_ros else [("ROS 2", scene.ros)]
        texts = [*sees, *other, ("Why", scene.why)]
        return ["", *(line for label, text in texts for line in self._labelled(label, text))]

    def table(self, rows: Sequence[tuple[str, str]]) -> list[str]:
        """Return a table of names and titles."""
        width = max(len(name) for name, _ in rows)
        return [
            f"{self._in(_BOLD, name)}{' ' * (width - len(name))}  {text}" for name, text in rows
        ]

    def note(self, text: str) -> str:
        """Return a line that is less important."""
        return self._in(_DIM, text)

    def _labelled(self, label: str, text: str) -> Iterator[str]:
        for number, line in enumerate(self._wrapped(text, _LABEL)):
            name = label if number == 0 else ""
            yield self._in(_BOLD, f"{name:<{_LABEL}}") + line

    def _wrapped(self, text: str, indent: int) -> list[str]:
        width = max(20, min(self.columns, MOST_COLUMNS) - indent - 2)
        return textwrap.wrap(text, width, break_on_hyphens=False) or [""]

    def _in(self, colour: str, text: str) -> str:
        return f"\x1b[{colour}m{text}\x1b[0m" if self.coloured and colour else text
