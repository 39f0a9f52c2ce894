"""Launch files in YAML, for inclusion."""

from __future__ import annotations

from typing import Any

from launch.launch_description_sources import FrontendLaunchDescriptionSource

from taskrpc.ros.module_names import add_module_names

from .parser import Parser


class YAMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A launch file in YAML."""

    def __init__(self, launch_file_path: Any) -> None:
        super().__init__(launch_file_path, parser=Parser, method="interpreted YAML launch file")


__all__ = ["YAMLLaunchDescriptionSource"]

add_module_names(__name__)
