"""The picture of `taskrpc top` as lines of text with roles; pure, for any size of terminal.

A role says what a piece of text means; `screen` gives it a colour. Each warning and each error has
a sign too, so that nothing is said by colour alone.
"""

from __future__ import annotations

import math
import time
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import NamedTuple, TypeAlias, TypeVar

from taskrpc.observe.top.model import NodeRow, ServiceRow, TaskRow, TaskServerRow, View

_Item = TypeVar("_Item")


class Role(Enum):
    """What a piece of text means."""

    PLAIN = "plain"
    TITLE = "title"
    DIM = "dim"
    GOOD = "good"
    WARNING = "warning"
    ERROR = "error"


class Span(NamedTuple):
    """A piece of a line."""

    text: str
    role: Role = Role.PLAIN


Line: TypeAlias = tuple[Span, ...]


class Signs(NamedTuple):
    """The signs of a picture; all have one column."""

    error: str
    warning: str
    running: str
    paused: str
    idle: str
    more: str
    none: str
    bullet: str


UNICODE = Signs("✕", "!", "▶", "‖", "○", "…", "-", "·")
ASCII = Signs("x", "!", ">", "=", "o", "~", "-", "|")

_NO_PROGRAM = "No taskrpc program runs here. Start one: taskrpc-server"
_NO_SERVICE = "No program offers a service."
_NAME, _WORK = 20, 32
"""The least columns of a name, and the most of a task's work."""
_WIDE = 60
"""Columns of a terminal that has room for words beside numbers."""
_ROOMY = 20
"""Rows of a terminal that has room for empty lines."""


def text_of(line: Line) -> str:
    """Return a line without its roles."""
    return "".join(span.text for span in line).rstrip()


def picture(view: View, columns: int = 0, rows: int = 0, signs: Signs = UNICODE) -> list[Line]:
    """Return the lines of a picture.

    `columns`: the width of the terminal; 0: as wide as the longest names need, with all columns.
    `rows`: its height; 0: as many rows as there are, without the footer.
    """
    painter = _Painter(
        columns,
        signs,
        [*(row.name for row in view.services), *(row.name for row in view.nodes)],
    )
    if not view.nodes:
        empty = painter.wrapped(_empty(view))
        footer = [painter.footer()] if rows else []
        return [*painter.head(view), (), *empty, *((),) * bool(rows), *footer]
    blocks = [painter.services(view), *map(painter.task_server, view.task_servers)]
    blocks.append(painter.nodes(view))
    is_roomy = not rows or rows >= _ROOMY
    gap: list[Line] = [()] if is_roomy else []
    head = painter.head(view)
    if rows:
        fixed = len(head) + 1 + sum(len(each.top) for each in blocks) + len(gap) * (len(blocks) + 1)
        room = _divided(rows - fixed, blocks)
    else:
        room = [len(each.lines) for each in blocks]
    lines = list(head)
    for block, count in zip(blocks, room, strict=True):
        lines += [*gap, *block.top, *painter.cut(block.lines, count)]
    if not rows:
        return lines
    lines = lines[: rows - 1]
    return [*lines, *((),) * (rows - 1 - len(lines)), painter.footer()]


def shares(room: int, wants: Sequence[int]) -> list[int]:
    """Divide rows among blocks: one each in turn, until all have what they want."""
    given = [0] * len(wants)
    while room > 0 and given != list(wants):
        for number, want in enumerate(wants):
            if given[number] < want and room > 0:
                given[number] += 1
                room -= 1
    return given


def _divided(room: int, blocks: Sequence[_Block]) -> list[int]:
    """Divide rows among blocks: first for the lines that matter, then for the others."""
    lines = [len(each.lines) for each in blocks]
    first = shares(room, [min(each.needed, len(each.lines)) for each in blocks])
    rest = shares(room - sum(first), [all_ - had for all_, had in zip(lines, first, strict=True)])
    return [a + b for a, b in zip(first, rest, strict=True)]


def seconds(value: float | None, signs: Signs = UNICODE) -> str:
    """Return a duration with its unit, in at most 7 columns: `0.12 ms`, `1.4 s`."""
    if value is None:
        return signs.none
    if value < 0.9995:
        return f"{_digits(value * 1000)} ms"
    return f"{_digits(value)} s" if value < 9999 else f"{value / 3600:.0f} h"


def per_second(value: float | None, signs: Signs = UNICODE) -> str:
    """Return a rate in at most 6 columns: `0.2`, `231`, `12k`."""
    if value is None:
        return signs.none
    if value < 0.095:
        return f"{max(value, 0.01):.2f}" if value else "0"
    if value < 9.95:
        return f"{value:.1f}"
    return f"{value:.0f}" if value < 99_999 else f"{value / 1000:.0f}k"


def width_of(text: str) -> int:
    """Return how many columns of a terminal a text takes."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(char) else 1 + (unicodedata.east_asian_width(char) in "WF")
        for char in text
    )


def fitted(text: str, width: int, more: str = "…") -> str:
    """Return the text in exactly this width; of a long one the end, which tells names apart."""
    if width_of(text) > width:
        while text and width_of(text) > width - 1:
            text = text[1:]
        text = (more + text) if width > 0 else ""
    return text + " " * (width - width_of(text))


def _digits(value: float) -> str:
    return f"{value:.2f}" if value < 0.995 else f"{value:.1f}" if value < 9.95 else f"{value:.0f}"


def _empty(view: View) -> str:
    where = f" in domain {view.domain}" if view.domain else ""
    if view.address:
        return f"No taskrpc program responds at {view.address}."
    text = _NO_PROGRAM.replace(" here", where or " here")
    if view.elsewhere:
        domain = view.elsewhere[0]
        text += f" Programs run in domain {domain}: set ROS_DOMAIN_ID={domain}."
    return text


class _Column(NamedTuple):
    """A column of a table."""

    title: str
    width: int
    """0: the column takes the room that the others leave."""
    from_width: int
    """The narrowest terminal that shows it."""
    cell: Callable[..., Span]
    right: bool = True


class _Block(NamedTuple):
    """A part of the picture: lines that are always shown, and lines of which some may be cut."""

    top: list[Line]
    lines: list[Line]
    needed: int = 1000
    """How many of the lines matter more than those of other blocks that do not."""


class _Painter:
    """Makes the lines for one width and one set of signs; `names` are those of all tables."""

    def __init__(self, columns: int, signs: Signs, names: Iterable[str]) -> None:
        self._columns = columns
        self._signs = signs
        self._longest = max([_NAME, *map(width_of, names)])
        """Columns of the longest name, so that all tables align."""
        self._gap = " " if 0 < columns < 52 else "  "
        """Between two columns of a table."""

    # The parts

    def head(self, view: View) -> list[Line]:
        """The title with the time, and the totals."""
        here = f"domain {view.domain}" if view.domain else "this machine"
        if view.nodes and not any(row.pid for row in view.nodes):  # such as the lab of a class
            here = " ".join(dict.fromkeys(row.program for row in view.nodes))
        address = view.address or here
        left, right = f"taskrpc top {self._signs.bullet} {address}", _clock(view.time)
        room = (self._columns or 80) - len(right)
        title = (Span(fitted(left, room, self._signs.more), Role.TITLE), Span(right, Role.DIM))
        return [title, self._totals(view)] if view.nodes else [title]

    def _totals(self, view: View) -> Line:
        parts = [Span(f"{per_second(view.per_second, self._signs)} calls/s")]
        if view.errors:
            role = Role.ERROR if view.errors_now else Role.PLAIN
            parts.append(Span(f"{self._signs.error} {_plural(view.errors, 'error')}", role))
        else:
            parts.append(Span("0 errors", Role.DIM))
        if problems := len({(row.pid, row.program) for row in view.nodes if row.problem}):
            text = f"{self._signs.warning} {_plural(problems, 'problem')}"
            parts.append(Span(text, Role.WARNING))
        parts.append(Span(f"{view.open} open", Role.DIM))
        parts.append(Span(_plural(view.programs, "program"), Role.DIM))
        if view.seconds > 0:
            parts.append(Span(f"last {view.seconds:.{int(view.seconds < 0.95)}f} s", Role.DIM))
        elif view.services:
            parts.append(Span("measuring", Role.DIM))
        line: list[Span] = []
        for part in parts:
            gap = 3 if line else 0
            used = sum(width_of(span.text) for span in line)
            if not self._columns or used + gap + width_of(part.text) <= self._columns:
                line += [Span(" " * gap), part] if gap else [part]
        return tuple(line)

    def services(self, view: View) -> _Block:
        """The table of services."""
        signs = self._signs
        columns = [
            _Column("SERVICE", 0, 0, lambda row: Span(row.name), right=False),
            _Column("CALLS/S", 7, 0, lambda row: _rate_cell(row.per_second, signs)),
            _Column("P50", 7, 56, lambda row: Span(seconds(row.p50, signs), _if(row.p50))),
            _Column("P99", 7, 0, lambda row: Span(seconds(row.p99, signs), _if(row.p99))),
            _Column("ERRORS", 6, 0, self._errors),
            _Column("RUN", 4, 72, lambda row: Span(f"{row.running}", _if(row.running))),
            _Column("WAIT", 6, 60, self._waiting),
            _Column("NODE", 24, 110, lambda row: Span(" ".join(row.nodes), Role.DIM), right=False),
        ]
        if not view.services:
            return _Block([], self.wrapped(_NO_SERVICE))
        called = sum(bool(row.codes or row.running or row.waiting) for row in view.services)
        return self._table(columns, view.services)._replace(needed=called + 1)

    def nodes(self, view: View) -> _Block:
        """The table of nodes; a program with a problem says it instead of its values."""
        signs = self._signs
        columns = [
            _Column("NODE", 0, 0, lambda row: Span(row.name), right=False),
            _Column("IN/S", 6, 0, lambda row: _rate_cell(row.calls_in, signs)),
            _Column("OUT/S", 6, 0, lambda row: _rate_cell(row.calls_out, signs)),
            _Column("CPU", 5, 52, lambda row: Span(_percent(row.cpu, signs), _if(row.cpu))),
            _Column("PID", 7, 60, lambda row: Span(str(row.pid or signs.none), Role.DIM)),
            _Column("PROGRAM", 18, 70, lambda row: Span(row.program, Role.DIM), right=False),
        ]
        return self._table(columns, view.nodes, self._problem)

    def task_server(self, server: TaskServerRow) -> _Block:
        """The robot and the queue of a task server."""
        if server.problem:
            what = Span(f"{self._signs.warning} {server.problem}", Role.WARNING)
            return _Block([self._clipped((Span(f"{server.service}  ", Role.TITLE), what))], [])
        return _Block([self._robot(server)], [self._task(task) for task in server.tasks])

    def wrapped(self, text: str) -> list[Line]:
        """A text in lines of the width."""
        lines, line = [], ""
        for word in text.split():
            if line and self._columns and len(line) + 1 + len(word) > self._columns:
                lines.append(line)
                line = word
            else:
                line = f"{line} {word}".lstrip()
        return [(Span(each),) for each in [*lines, line]]

    def footer(self) -> Line:
        """The keys."""
        return self._clipped((Span("q", Role.TITLE), Span(" ends", Role.DIM)))

    def cut(self, lines: list[Line], count: int) -> list[Line]:
        """The first lines; if not all fit, the last one says how many are missing."""
        if len(lines) <= count:
            return lines
        missing = len(lines) - max(0, count - 1)
        return [*lines[: count - 1], (Span(f"{self._signs.more} {missing} more", Role.DIM),)][
            :count
        ]

    # Rows and cells

    def _robot(self, server: TaskServerRow) -> Line:
        sign, role = {
            "working": (self._signs.running, Role.GOOD),
            "paused": (self._signs.paused, Role.WARNING),
            "idle": (self._signs.idle, Role.DIM),
        }[server.state]
        spans = [
            Span(server.service, Role.TITLE),
            Span(f"  {sign} {server.state}", role),
            Span(f"  {server.queued} queued", Role.PLAIN if server.queued else Role.DIM),
        ]
        if (pose := server.pose) is not None:
            heading = math.degrees(pose.theta) % 360
            where = f"  robot at {pose.x:.1f}, {pose.y:.1f} m, heading {heading:.0f}°"
            spans.append(Span(where, Role.DIM))
        kept: list[Span] = []
        for span in spans:
            used = sum(width_of(each.text) for each in kept)
            if not self._columns or used + width_of(span.text) <= self._columns or not kept:
                kept.append(span)
        return self._clipped(tuple(kept))

    def _task(self, task: TaskRow) -> Line:
        runs = task.state != "QUEUED"
        sign, role = " ", Role.PLAIN
        if runs:
            halted = task.state in ("PAUSED", "CANCELING")
            sign = self._signs.paused if halted else self._signs.running
            role = Role.WARNING if halted else Role.GOOD
        state = f"{task.progress:.0%}" if runs else "queued"
        done = f"{task.done_in:.0f} s" if task.done_in >= 100 else f"{task.done_in:.1f} s"
        is_wide = not self._columns or self._columns >= _WIDE
        tail = f"  prio {task.priority:>2}  {state:>6}  in {done:>7}"
        if not is_wide:
            tail = f" {task.priority:>2} {state.replace('queued', ''):>4} {done:>7}"
        client = ""
        if not self._columns or self._columns >= 80:
            client = f"  {fitted(task.client, 16, self._signs.more)}"
        head = f"{sign} {task.task_id:>4}  " if is_wide else f"{sign}{task.task_id:>3} "
        room = min(_WORK, (self._columns or 100) - len(head) - len(tail) - len(client))
        work = task.work if width_of(task.work) <= room else _start(task.work, room, self._signs)
        work += " " * (room - width_of(work))
        return (Span(head + work, role), Span(tail, role), Span(client, Role.DIM))

    def _errors(self, row: ServiceRow) -> Span:
        if not row.errors:
            return Span("0", Role.DIM)
        return Span(f"{self._signs.error} {row.errors}", Role.ERROR if row.errors_now else _SEEN)

    def _waiting(self, row: ServiceRow) -> Span:
        if not row.waiting:
            return Span("0", Role.DIM)
        return Span(f"{self._signs.warning} {row.waiting}", Role.WARNING)

    def _problem(self, row: NodeRow) -> Line | None:
        if not row.problem:
            return None
        name = "" if row.problem.startswith(row.name) else f"{row.name}: "
        return (Span(f"{self._signs.warning} {name}{row.problem}", Role.WARNING),)

    # Tables

    def _table(
        self,
        columns: list[_Column],
        rows: Sequence[_Item],
        instead: Callable[[_Item], Line | None] = lambda _: None,
    ) -> _Block:
        shown = [each for each in columns if not self._columns or each.from_width <= self._columns]
        cells = [[each.cell(row) for each in shown] for row in rows]
        widths = self._widths(shown, cells)
        titles = [Span(each.title, Role.DIM) for each in shown]
        lines = [
            self._clipped(other) if (other := instead(row)) else self._row(shown, widths, line)
            for row, line in zip(rows, cells, strict=True)
        ]
        return _Block([self._row(shown, widths, titles)], lines)

    def _widths(self, shown: list[_Column], cells: list[list[Span]]) -> list[int]:
        widths = [each.width for each in shown]
        longest = [
            max([len(each.title), *(width_of(line[number].text) for line in cells)])
            for number, each in enumerate(shown)
        ]
        longest[0] = max(longest[0], self._longest)
        if not self._columns:
            return [max(pair) for pair in zip(widths, longest, strict=True)]
        left = self._columns - sum(widths) - len(self._gap) * (len(widths) - 1)
        # As wide as the names: in a wide terminal, the numbers stay near them.
        widths[0] = max(4, min(left, longest[0]))
        return widths

    def _row(self, shown: list[_Column], widths: list[int], cells: Iterable[Span]) -> Line:
        spans: list[Span] = []
        for column, width, cell in zip(shown, widths, cells, strict=True):
            if spans:
                spans.append(Span(self._gap))
            text = fitted(cell.text, width, self._signs.more)
            if column.right:
                bare = text.rstrip()
                text = " " * (width - width_of(bare)) + bare
            spans.append(Span(text, cell.role))
        return tuple(spans)

    def _clipped(self, line: Line) -> Line:
        """The start of a line, in the width."""
        if not self._columns or width_of(text_of(line)) <= self._columns:
            return line
        spans, room = [], self._columns
        for text, role in line:
            part = text if width_of(text) <= room else _start(text, room, self._signs)
            spans.append(Span(part, role))
            room -= width_of(part)
            if part is not text:
                break
        return tuple(spans)


_SEEN = Role.PLAIN  # errors that are older than the window


def _start(text: str, width: int, signs: Signs) -> str:
    if width < 1:
        return ""
    while width_of(text) > width - 1:
        text = text[:-1]
    return text + signs.more


def _if(value: float | None) -> Role:
    """The role of a value that is dim while it is nothing."""
    return Role.PLAIN if value else Role.DIM


def _rate_cell(value: float | None, signs: Signs) -> Span:
    return Span(per_second(value, signs), _if(value))


def _percent(value: float | None, signs: Signs) -> str:
    return signs.none if value is None else f"{value * 100:.0f} %"


def _plural(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _clock(moment: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(moment))
