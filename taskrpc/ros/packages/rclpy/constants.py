"""Constants of rclpy."""

S_TO_NS = 1_000_000_000
"""Nanoseconds of one second."""
