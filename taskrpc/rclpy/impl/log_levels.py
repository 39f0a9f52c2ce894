"""From which severity on each logger logs; those without a level of their own ask their parent."""

from __future__ import annotations

from .logging_severity import LoggingSeverity

SEPARATOR = "."
"""Between the name of a logger and that of its child."""

DEFAULT = int(LoggingSeverity.INFO)
"""The level of all loggers, unless somebody sets another."""

_levels: dict[str, int] = {"": DEFAULT}
_effective: dict[str, int] = {}  # found once: every line that is logged asks


def set_level(name: str, level: int) -> None:
    """Set the level of a logger, of all loggers by the name ""."""
    _levels[name] = level
    _effective.clear()


def level_of(name: str) -> int:
    """The level that was set for just this logger; 0 where there is none."""
    return _levels.get(name, 0)


def effective_level_of(name: str) -> int:
    """The level that holds for a logger."""
    level = _effective.get(name)
    if level is None:
        level = _effective[name] = _find(name)
    return level


def _find(name: str) -> int:
    ancestor = name
    while ancestor:
        if level := level_of(ancestor):
            return level
        ancestor = ancestor.rpartition(SEPARATOR)[0]
    return level_of("")


def clear() -> None:
    """Forget every level that was set."""
    _levels.clear()
    _levels[""] = DEFAULT
    _effective.clear()
