"""Markers that a user can move and click in a 3D view, with the classes of `interactive_markers`.

taskrpc has no 3D view; rviz2 on a real ROS 2 shows the markers. Start with
`interactive_marker_server`. Only programs import this package.
"""

from .interactive_marker_server import InteractiveMarkerServer
from .menu_handler import MenuHandler

__all__ = ["InteractiveMarkerServer", "MenuHandler"]
