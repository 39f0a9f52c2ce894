"""rclpy's compiled part by the name under which rclpy itself knows it."""

from .. import _rclpy_pybind11 as rclpy_implementation

__all__ = ["rclpy_implementation"]
