"""Substitutions of ROS: the folders of packages, executables, and parameters."""

from __future__ import annotations

from typing import Any

from ament_index_python.packages import get_package_prefix, get_package_share_directory
from launch.substitution import (
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform,
    perform_substitutions,
)
from launch.substitutions import PathJoinSubstitution

from taskrpc.ros import hook, installed, workspace
from taskrpc.ros.module_names import add_module_names

from .parameters import PARAMETERS


class _OfPackage(Substitution):
    def __init__(self, package: Any) -> None:
        self._package = normalize_to_list_of_substitutions(package)

    @property
    def package(self) -> Any:
        """The package's name, before it is computed."""
        return self._package

    def describe(self) -> str:
        """Describe the substitution."""
        name = " + ".join(each.describe() for each in self._package)
        return f"{type(self).__name__}(package={name})"

    def __truediv__(self, other: Any) -> Any:
        return PathJoinSubstitution([self, other])


class FindPackageShare(_OfPackage):
    """The folder with a package's launch, configuration and other files."""

    def perform(self, context: Any) -> str:
        """Find the folder."""
        return str(get_package_share_directory(perform_substitutions(context, self._package)))

    def find(self, package_name: str) -> str:
        """Find the folder of a package."""
        return str(get_package_share_directory(package_name))


FindPackage = FindPackageShare


class FindPackagePrefix(_OfPackage):
    """The folder below which a package is installed; here its source folder."""

    def perform(self, context: Any) -> str:
        """Find the folder."""
        return str(get_package_prefix(perform_substitutions(context, self._package)))

    def find(self, package_name: str) -> str:
        """Find the folder of a package."""
        return str(get_package_prefix(package_name))


class ExecutableInPackage(Substitution):
    """The path of an executable of a package."""

    def __init__(self, executable: Any, package: Any) -> None:
        self._executable = normalize_to_list_of_substitutions(executable)
        self._package = normalize_to_list_of_substitutions(package)

    def describe(self) -> str:
        """Describe the substitution."""
        name = " + ".join(each.describe() for each in self._executable)
        return f"ExecInPkg(executable={name})"

    def perform(self, context: Any) -> str:
        """Find the file; raises SubstitutionFailure if the package installs no such script."""
        package = perform_substitutions(context, self._package)
        executable = perform_substitutions(context, self._executable)
        folder = workspace.packages(*hook.starts()).get(package)
        path = None if folder is None else installed.script(folder, executable)
        if path is None:
            raise SubstitutionFailure(
                f"executable '{executable}' not found in the package '{package}'"
            )
        return str(path)


class Parameter(Substitution):
    """The value of a parameter that `SetParameter` has set."""

    def __init__(self, name: Any, *, default: Any = None) -> None:
        self._name = normalize_to_list_of_substitutions(name)
        self._default = default

    def describe(self) -> str:
        """Describe the substitution."""
        return f"Parameter({' + '.join(each.describe() for each in self._name)})"

    def perform(self, context: Any) -> str:
        """Look the parameter up; raises SubstitutionFailure if it is not set."""
        name = perform_substitutions(context, self._name)
        for each in context.launch_configurations.get(PARAMETERS, ()):
            if isinstance(each, tuple) and each[0] == name:
                return str(each[1])
        if self._default is None:
            raise SubstitutionFailure(f"parameter '{name}' is not set")
        default = self._default
        is_plain = isinstance(default, (bool, int, float))
        return str(default) if is_plain else str(perform(context, default))


__all__ = [
    "ExecutableInPackage",
    "FindPackage",
    "FindPackagePrefix",
    "FindPackageShare",
    "Parameter",
]

add_module_names(__name__)
