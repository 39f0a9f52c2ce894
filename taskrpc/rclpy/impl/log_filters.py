"""What keeps a line of the log back: `throttle_duration_sec=`, `skip_first=`, `once=`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from ..clock import Clock


class LoggingFilter(Protocol):
    """Remembers, for one place in the program, what it logged before."""

    def should_log(self) -> bool:
        """Whether the next line may be logged."""
        ...


class Throttle:
    """Lets a line through when the last one is long enough ago."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self._clock = options["throttle_time_source_type"]
        if not isinstance(self._clock, Clock):
            raise ValueError(
                f'Received throttle_time_source_type of "{self._clock}" is not a clock instance'
            )
        self._ns = options["throttle_duration_sec"] * 1e9
        self._last = 0

    def should_log(self) -> bool:
        """Whether enough time of its clock has gone by."""
        now = self._clock.now().nanoseconds
        if now < self._last + self._ns:
            return False
        self._last = now
        return True


class SkipFirst:
    """Lets every line through but the first."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self._skipped = False

    def should_log(self) -> bool:
        """False the first time."""
        skipped, self._skipped = self._skipped, True
        return skipped


class Once:
    """Lets the first line through and no other."""

    def __init__(self, options: Mapping[str, Any]) -> None:
        self._logged = False

    def should_log(self) -> bool:
        """True the first time."""
        logged, self._logged = self._logged, True
        return not logged


_CLOCK = Clock()
_FILTERS: dict[str, tuple[type[Throttle | SkipFirst | Once], dict[str, Any]]] = {
    "throttle": (
        Throttle,
        {"throttle_duration_sec": None, "throttle_time_source_type": _CLOCK},
    ),
    "skip_first": (SkipFirst, {"skip_first": None}),
    "once": (Once, {"once": None}),
}
"""In the order in which they are asked; an option whose default is None must be given."""

_OPTIONS = [name for _, defaults in _FILTERS.values() for name in defaults]


def settings(options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Which filters a call of the logger asks for, each with its options.

    Raises TypeError for an option that does not exist, or lacks another that it needs.
    """
    found: dict[str, dict[str, Any]] = {}
    for kind, (_, defaults) in _FILTERS.items():
        if any(options.get(name) for name in defaults):
            found[kind] = {name: options.get(name, defaults[name]) for name in defaults}
            for name, value in found[kind].items():
                if value is None:
                    raise TypeError(
                        f'required parameter "{name}" not specified but is required for the'
                        f' the logging filter "{kind}"'
                    )
    for name in options:
        if name not in _OPTIONS:
            raise TypeError(
                f'parameter "{name}" is not one of the recognized logging options "{_OPTIONS}"'
            )
    return found


def filters_of(wanted: Mapping[str, dict[str, Any]]) -> list[LoggingFilter]:
    """New filters, one for each entry of what `settings` returned."""
    return [_FILTERS[kind][0](options) for kind, options in wanted.items()]
