"""The compiled part of rclpy, under the name that rclpy itself uses."""

from .. import _rclpy_pybind11 as rclpy_implementation

__all__ = ["rclpy_implementation"]
