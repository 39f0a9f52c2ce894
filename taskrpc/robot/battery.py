"""The battery's charge in closed form; telemetry only, it never stops the robot."""

FULL = 100.0
"""Percent."""

_FLOOR = 5.0  # a stub that dies in a long demonstration would teach nobody anything
_PER_METRE = 0.2  # percent
_PER_SECOND = 0.01  # percent; the computer and the sensors
_CHARGE_PER_SECOND = 0.5  # percent


def driven(level: float, seconds: float, metres: float) -> float:
    """The charge in percent after a drive."""
    return max(_FLOOR, level - _PER_METRE * metres - _PER_SECOND * seconds)


def stood(level: float, seconds: float, *, docked: bool) -> float:
    """The charge in percent after standing; the dock fills it up."""
    if docked:
        return min(FULL, level + _CHARGE_PER_SECOND * seconds)
    return max(_FLOOR, level - _PER_SECOND * seconds)
