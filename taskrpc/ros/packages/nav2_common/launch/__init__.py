"""Substitutions for parameter files, as launch files import them from `nav2_common.launch`.

Start with `substitutions`, which reads and writes the files. Other substitutions are in `launch`.
"""

from taskrpc.ros.module_names import add_module_names

from .substitutions import (
    HasNodeParams,
    LaunchConfigAsBool,
    ParseMultiRobotPose,
    ReplaceString,
    RewrittenYaml,
)

__all__ = [
    "HasNodeParams",
    "LaunchConfigAsBool",
    "ParseMultiRobotPose",
    "ReplaceString",
    "RewrittenYaml",
]

add_module_names(__name__)
