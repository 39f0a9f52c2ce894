"""What rclpy calls experimental: the events executor."""

from .events_executor import EventsExecutor

__all__ = ["EventsExecutor"]
