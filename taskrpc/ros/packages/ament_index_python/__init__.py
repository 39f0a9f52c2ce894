"""The folders of packages, by name, with the functions of ROS's `ament_index_python`.

ROS looks among installed packages; here the sources in the workspace around the program come first.
Every function is in `packages`, as in ROS. Only programs import this package, under ROS's name.
"""

from .packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
    get_package_share_path,
    get_packages_with_prefixes,
)

__all__ = [
    "PackageNotFoundError",
    "get_package_prefix",
    "get_package_share_directory",
    "get_package_share_path",
    "get_packages_with_prefixes",
]
