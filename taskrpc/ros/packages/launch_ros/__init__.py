"""Nodes in launch files: ROS's package `launch_ros`.

Start with `actions.node`, which starts a node as `taskrpc run` does. `parameters` turns parameters
and remappings into arguments. What has nothing to do with ROS is in the package `launch`.
"""

from . import actions, descriptions, event_handlers, events, parameter_descriptions, substitutions

__all__ = [
    "actions",
    "descriptions",
    "event_handlers",
    "events",
    "parameter_descriptions",
    "substitutions",
]
