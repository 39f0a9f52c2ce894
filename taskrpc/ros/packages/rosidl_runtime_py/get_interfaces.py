"""Lists the interfaces of packages."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import srvgen
from srvgen.classes.loader import search
from srvgen.files import archive
from srvgen.files.reading import KINDS

if TYPE_CHECKING:  # type checkers know a package by its name in ROS only
    from ament_index_python.packages import get_packages_with_prefixes
else:
    from taskrpc.ros.packages.ament_index_python.packages import get_packages_with_prefixes

Interfaces: TypeAlias = dict[str, list[str]]
"""Names such as `msg/String`, by the names of their packages."""


def get_interface_packages() -> list[str]:
    """The packages that have interfaces."""
    return sorted(search().packages())


def get_interfaces(package_names: Iterable[str] = ()) -> Interfaces:
    """The interfaces of the named packages, or of all packages.

    Packages without interfaces are left out. Raises LookupError for a package that does not exist.
    """
    return _interfaces(package_names)


def get_message_interfaces(package_names: Iterable[str] = ()) -> Interfaces:
    """The messages of packages; parameters and errors as `get_interfaces`."""
    return _interfaces(package_names, ["msg"])


def get_service_interfaces(package_names: Iterable[str] = ()) -> Interfaces:
    """The services of packages; parameters and errors as `get_interfaces`."""
    return _interfaces(package_names, ["srv"])


def get_action_interfaces(package_names: Iterable[str] = ()) -> Interfaces:
    """The actions of packages; parameters and errors as `get_interfaces`."""
    return _interfaces(package_names, ["action"])


def get_interface_path(interface_name: str) -> str:
    """The file that defines an interface: `std_msgs/msg/String`, or `std_msgs/msg/String.msg`.

    Raises ValueError for an invalid name, and LookupError if there is no such interface or if its
    file has a different suffix (there are no .idl files).
    """
    parts = interface_name.split("/")
    if len(parts) < 2:
        raise ValueError(
            f"Invalid name '{interface_name}'. Expected at least two parts separated by '/'"
        )
    *folders, last = parts
    name, dot, kind = last.partition(".")
    try:
        path: Path = search().find("/".join([*folders, name]))
    except srvgen.DefinitionError:
        path = Path()
    if path == Path() or (dot and path.suffix != f".{kind}"):
        raise LookupError(f"Could not find the interface '{interface_name}'")
    if archive.ARCHIVE in path.parents:
        return str(archive.unpacked(parts[0]) / path.parent.name / path.name)
    return str(path)


def _interfaces(package_names: Iterable[str], kinds: Collection[str] = KINDS) -> Interfaces:
    found = {}
    names = list(package_names)
    with search().cached_lookups():
        known = search().packages()
        for package in names or known:
            if package in known:
                parts = [name.split("/") for name in search().interfaces(package)]
                if inside := sorted(f"{kind}/{name}" for _, kind, name in parts if kind in kinds):
                    found[package] = inside
            elif package not in get_packages_with_prefixes():
                raise LookupError(f"Unknown package '{package}'")
    return found
