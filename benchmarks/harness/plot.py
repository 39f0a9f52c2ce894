"""Ratios as bars to both sides of the baseline, on a logarithmic scale, in panels side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.harness.svg import Drawing
from benchmarks.harness.tables import UNKNOWN

_ROW, _BAR = 22, 12
_TOP, _BOTTOM = 74, 40
_LABELS, _PANEL, _GAP = 190, 320, 24
_ROOM = 44
"""Left and right of the bars, for the numbers at their ends."""


@dataclass(frozen=True)
class Row:
    """One contender: a ratio a panel, None where it was not measured."""

    name: str
    ratios: tuple[float | None, ...]
    kind: str = "peer"
    """`ours`, `limit` or `peer`: its colour."""


@dataclass(frozen=True)
class Panel:
    """One measure."""

    title: str
    note: str


def bars(title: str, panels: Sequence[Panel], rows: Sequence[Row], footnote: str) -> str:
    """An SVG picture with a row a contender; bars begin at the baseline, whose ratio is 1."""
    width = _LABELS + len(panels) * (_PANEL + _GAP)
    drawing = Drawing(width, _TOP + _ROW * len(rows) + _BOTTOM, title)
    drawing.text(16, 26, title, "title")
    for place, row in enumerate(rows):
        kind = "end strong" if row.kind == "ours" else "end"
        drawing.text(_LABELS - 8, _middle(place) + 4, row.name, kind)
    for number, panel in enumerate(panels):
        ratios = [row.ratios[number] for row in rows]
        left = _LABELS + number * (_PANEL + _GAP)
        _panel(drawing, left, panel, ratios, [row.kind for row in rows])
    drawing.text(16, _TOP + _ROW * len(rows) + 26, footnote, "note")
    return drawing.render()


def _panel(
    drawing: Drawing,
    left: float,
    panel: Panel,
    ratios: Sequence[float | None],
    kinds: Sequence[str],
) -> None:
    known = [ratio for ratio in ratios if ratio] or [1.0]
    low, high = math.log10(min(*known, 0.5)), math.log10(max(*known, 2.0))
    step = (_PANEL - 2 * _ROOM) / (high - low)

    def place(ratio: float) -> float:
        return left + _ROOM + (math.log10(ratio) - low) * step

    bottom = _TOP + _ROW * len(ratios)
    drawing.text(left + _ROOM, 48, panel.title, "strong")
    drawing.text(left + _ROOM, 64, panel.note, "note")
    for tick in _ticks(low, high):
        drawing.line(place(tick), _TOP, place(tick), bottom, "base" if tick == 1 else "grid")
        drawing.text(place(tick), bottom + 12, f"{tick:g}", "note middle")
    for row, (ratio, kind) in enumerate(zip(ratios, kinds, strict=True)):
        if ratio is None:
            drawing.text(place(1) + 5, _middle(row) + 4, UNKNOWN, "note")
            continue
        drawing.bar(place(1), place(ratio), _middle(row) - _BAR / 2, _BAR, kind)
        x, anchor = (place(ratio) + 5, "") if ratio >= 1 else (place(ratio) - 5, "end")
        drawing.text(x, _middle(row) + 4, _shown(ratio), anchor)


def _shown(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.1f}" if ratio >= 2 else f"{ratio:.2f}"


def _middle(row: int) -> float:
    return _TOP + _ROW * (row + 0.5)


def _ticks(low: float, high: float) -> list[float]:
    """Powers of ten within the range, and what lies between where they are few."""
    steps = (1, 2, 5) if high - low < 2.5 else (1,)
    powers = range(math.floor(low), math.ceil(high) + 1)
    ticks = [step * 10.0**power for power in powers for step in steps]
    return [tick for tick in ticks if low - 1e-9 <= math.log10(tick) <= high + 1e-9]
