"""Markdown tables, and numbers as they stand in them."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.harness.results import Figure

_UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))
UNKNOWN = "\N{EN DASH}"
TIMES = "\N{MULTIPLICATION SIGN}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table; all columns but the first are aligned to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def duration(seconds: float) -> str:
    """Seconds with the unit that suits them."""
    factor, unit = next((each for each in _UNITS if seconds >= each[0]), _UNITS[-1])
    return f"{significant(seconds / factor)} {unit}"


def significant(value: float) -> str:
    """Three figures, thousands apart."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def ratio(figure: Figure | None) -> str:
    """The ratio to the baseline."""
    return significant(figure.ratio) if figure else UNKNOWN


def spread(figure: Figure | None) -> str:
    """The ratio to the baseline, with the least and the greatest of the rounds."""
    if figure is None:
        return UNKNOWN
    return f"**{ratio(figure)}** ({significant(figure.low)}…{significant(figure.high)})"
