"""The model of a scene: its texts, and which lines of its programs the class looks at; pure."""

from __future__ import annotations

import textwrap
from enum import Enum
from typing import NamedTuple

import msgspec


class Hang(Enum):
    """Whether the program with the mistake waits for ever."""

    NEVER = "never"
    LIKE_ROS = "like ROS"
    """Only if it behaves exactly like ROS 2; otherwise taskrpc ends the wait."""
    ALWAYS = "always"


class Line(NamedTuple):
    """A line of a program."""

    number: int
    text: str
    is_marked: bool
    """Whether the class should look at this line."""


class Excerpt(msgspec.Struct, frozen=True):
    """Which lines of a program are shown.

    Attributes:
        first: a text in the first line that is shown.
        last: a text in the last one.
        marks: each of these texts is in one line at which the class should look.
    """

    first: str
    last: str
    marks: tuple[str, ...]

    def lines(self, program: str) -> list[Line]:
        """Return the lines of a program, moved to the left as far as possible.

        Raises ValueError if a text is in no line, or in several.
        """
        texts = program.splitlines()
        marked = {_index(texts, mark) for mark in self.marks}
        begin, end = _index(texts, self.first), _index(texts, self.last)
        moved = textwrap.dedent("\n".join(texts[begin : end + 1])).split("\n")
        return [Line(at, text, at - 1 in marked) for at, text in enumerate(moved, begin + 1)]


def _index(texts: list[str], part: str) -> int:
    found = [index for index, text in enumerate(texts) if part in text]
    if len(found) != 1:
        raise ValueError(f"expected one line with {part!r}, found {len(found)}")
    return found[0]


class Scene(msgspec.Struct, frozen=True):
    """A scene of a lecture.

    Attributes:
        name: its name on the command line: `lost-reply`.
        title: the point in a few words.
        sees: what happens with taskrpc.
        ros: what ROS 2 does, and taskrpc with `--like-ros`.
        why: the cause.
        cure: what to do instead.
        problem: the lines of the program with the mistake that are shown.
        cured: the lines of the corrected program that are shown.
        robot: whether the programs call a robot.
        faults: the faults of the robot's services, as `taskrpc-server --fault` takes them.
        hangs: whether the program with the mistake waits for ever.
        simulated: whether `taskrpc simulate` runs the program many times afterwards; ROS 2 cannot.
    """

    name: str
    title: str
    sees: str
    ros: str
    why: str
    cure: str
    problem: Excerpt
    cured: Excerpt
    robot: bool = False
    faults: tuple[str, ...] = ()
    hangs: Hang = Hang.NEVER
    simulated: bool = False

    def will_hang(self, *, like_ros: bool) -> bool:
        """Return whether the program with the mistake waits for ever."""
        return self.hangs is Hang.ALWAYS or (like_ros and self.hangs is Hang.LIKE_ROS)
