"""The ids of goals, as rclpy prints them."""

from __future__ import annotations


def shown(goal_id: bytes) -> str:
    """Return an id as in the log lines of ROS: 16 numbers of one width, without commas."""
    numbers = [str(number) for number in goal_id]
    width = max(map(len, numbers))
    return f"[{' '.join(number.rjust(width) for number in numbers)}]"
