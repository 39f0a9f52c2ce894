"""Functions that choose nodes, under the name of ROS's module."""

from .lifecycle import matches_node_name

__all__ = ["matches_node_name"]
