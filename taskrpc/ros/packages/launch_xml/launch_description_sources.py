"""Launch files in XML, for inclusion."""

from __future__ import annotations

from typing import Any

from launch.launch_description_sources import FrontendLaunchDescriptionSource

from taskrpc.ros.module_names import add_module_names

from .parser import Parser


class XMLLaunchDescriptionSource(FrontendLaunchDescriptionSource):
    """A launch file in XML."""

    def __init__(self, launch_file_path: Any) -> None:
        super().__init__(launch_file_path, parser=Parser, method="interpreted XML launch file")


__all__ = ["XMLLaunchDescriptionSource"]

add_module_names(__name__)
