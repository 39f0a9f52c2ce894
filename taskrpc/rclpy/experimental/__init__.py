"""The events executor, which rclpy calls experimental.

`events_executor` has the class; start with `rclpy.executors`, which has its base class. Only names
of ROS's package belong here.
"""

from .events_executor import EventsExecutor

__all__ = ["EventsExecutor"]
