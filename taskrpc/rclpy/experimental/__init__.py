"""The events executor, which rclpy calls experimental.

`events_executor` has the class; it derives from `rclpy.executors`, where to start reading. Nothing
that is not in ROS's package of this name belongs here.
"""

from .events_executor import EventsExecutor

__all__ = ["EventsExecutor"]
