"""growth.svg: a small log-log panel for each curve, a row for each topic."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

from benchmarks.growing.curves import Curve
from benchmarks.harness.svg import Drawing
from benchmarks.harness.tables import significant

_WIDTH, _HEIGHT = 168, 96
_LEFT, _GAP_X, _GAP_Y = 64, 104, 74
_TOP = 92
_COLUMNS = 4
_Place: TypeAlias = Callable[[float], float]
_DOT = 6


def picture(title: str, topics: Sequence[tuple[str, Sequence[Curve]]]) -> str:
    """An SVG picture; all panels of a topic have the same sizes from left to right."""
    rows = [
        (name, curves[start : start + _COLUMNS])
        for name, curves in topics
        for start in range(0, len(curves), _COLUMNS)
    ]
    width = _LEFT + _COLUMNS * (_WIDTH + _GAP_X)
    drawing = Drawing(width, _TOP + len(rows) * (_HEIGHT + _GAP_Y), title)
    drawing.text(16, 26, title, "title")
    drawing.text(16, 44, "Both axes are logarithmic; the dashed line is linear growth.", "note")
    for row, (name, curves) in enumerate(rows):
        for column, curve in enumerate(each.known for each in curves):
            left, top = _LEFT + column * (_WIDTH + _GAP_X), _TOP + row * (_HEIGHT + _GAP_Y)
            _panel(drawing, left, top, name, curve)
    return drawing.render()


def _panel(drawing: Drawing, left: float, top: float, topic: str, curve: Curve) -> None:
    if not curve.sizes:
        return
    sizes = [math.log10(size) for size in curve.sizes]
    values = [math.log10(value) for value in curve.values]
    low, high = _range(values)

    def x(size: float) -> float:
        return left + (size - sizes[0]) / max(sizes[-1] - sizes[0], 1e-9) * _WIDTH

    def y(value: float) -> float:
        return top + _HEIGHT - (value - low) / (high - low) * _HEIGHT

    drawing.text(left, top - 20, curve.measure.title, "strong")
    drawing.text(left, top - 7, f"{curve.measure.unit}; exponent {curve.exponent:+.2f}", "note")
    for power in range(low, high + 1):
        drawing.line(left, y(power), left + _WIDTH, y(power), "grid")
        drawing.text(left - 5, y(power) + 4, f"{10.0**power:g}", "note end")
    slope = -1 if curve.measure.is_rate else 1
    _linear(drawing, (sizes[0], sizes[-1]), (low, high), values[0], slope, (x, y))
    for size, value in zip(sizes, values, strict=True):
        drawing.bar(x(size) - _DOT / 2, x(size) + _DOT / 2, y(value) - _DOT / 2, _DOT, "ours")
    for size, shown in ((sizes[0], curve.sizes[0]), (sizes[-1], curve.sizes[-1])):
        drawing.text(x(size), top + _HEIGHT + 14, f"{shown:,}", "note middle")
    drawing.text(x((sizes[0] + sizes[-1]) / 2), top + _HEIGHT + 14, topic, "note middle")
    drawing.text(x(sizes[-1]) + 6, y(values[-1]) + 4, significant(curve.values[-1]), "note")


def _range(values: Sequence[float]) -> tuple[int, int]:
    """Two powers of ten at least, so that noise does not look like growth."""
    low, high = math.floor(min(values)), math.ceil(max(values))
    return low, max(high, low + 2)


def _linear(
    drawing: Drawing,
    sizes: tuple[float, float],
    limits: tuple[int, int],
    start: float,
    slope: int,
    place: tuple[_Place, _Place],
) -> None:
    """What linear growth from the first point on would be, as far as the panel shows it."""
    low, high = limits
    room = (high - start) if slope > 0 else (start - low)
    reach = min(sizes[1] - sizes[0], room)
    x, y = place
    drawing.line(x(sizes[0]), y(start), x(sizes[0] + reach), y(start + slope * reach), "base")
