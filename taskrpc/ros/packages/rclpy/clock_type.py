"""The kinds of clocks."""

from __future__ import annotations

import enum


class ClockType(enum.IntEnum):
    """The kinds of clocks; times of different kinds cannot be compared or subtracted."""

    ROS_TIME = 1
    """The system time, or the time from `/clock` while `use_sim_time` is true."""
    SYSTEM_TIME = 2
    """The time since 1970; may jump."""
    STEADY_TIME = 3
    """The time since an unspecified moment; never jumps."""
