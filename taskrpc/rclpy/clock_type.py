"""Which clock a time was read from."""

from __future__ import annotations

import enum


class ClockType(enum.IntEnum):
    """Times of different clocks cannot be compared or subtracted."""

    ROS_TIME = 1
    """The system's time, or what arrives on `/clock` while `use_sim_time` is set."""
    SYSTEM_TIME = 2
    """Since 1970; may jump."""
    STEADY_TIME = 3
    """Since some moment; never jumps."""
