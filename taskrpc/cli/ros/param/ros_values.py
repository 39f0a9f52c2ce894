"""rclpy's conversions of parameters, which only some commands import.

A type checker knows rclpy by its name in ROS only; a command uses it without the import hook.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.parameter import (
        get_parameter_value,
        parameter_dict_from_yaml_file,
        parameter_value_to_python,
    )
else:
    from taskrpc.ros.packages.rclpy.parameter import (
        get_parameter_value,
        parameter_dict_from_yaml_file,
        parameter_value_to_python,
    )

__all__ = ["get_parameter_value", "parameter_dict_from_yaml_file", "parameter_value_to_python"]
