"""Events of ROS in launch files.

`lifecycle` has the events of lifecycle nodes. Other events are in `launch.events`.
"""

from . import lifecycle
from .lifecycle import matches_node_name

__all__ = ["lifecycle", "matches_node_name"]
