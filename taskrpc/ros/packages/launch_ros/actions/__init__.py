"""Actions of ROS in launch files.

`node` starts nodes, `lifecycle` also changes their states, `settings` changes all nodes that start
later, and `not_here` has the actions that only say what taskrpc does not have. Other actions are in
`launch.actions`.
"""

from launch.actions import TimerAction

from taskrpc.ros.module_names import add_module_names

from .lifecycle import LifecycleNode, LifecycleTransition
from .node import Node
from .not_here import ComposableNodeContainer, LoadComposableNodes
from .settings import (
    PushROSNamespace,
    PushRosNamespace,
    SetParameter,
    SetParametersFromFile,
    SetRemap,
    SetROSLogDir,
    SetUseSimTime,
)

ROSTimer = RosTimer = TimerAction

__all__ = [
    "ComposableNodeContainer",
    "LifecycleNode",
    "LifecycleTransition",
    "LoadComposableNodes",
    "Node",
    "PushROSNamespace",
    "PushRosNamespace",
    "ROSTimer",
    "RosTimer",
    "SetParameter",
    "SetParametersFromFile",
    "SetROSLogDir",
    "SetRemap",
    "SetUseSimTime",
]

add_module_names(__name__)
