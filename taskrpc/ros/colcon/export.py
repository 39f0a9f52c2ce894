"""Exports a folder of programs and definitions as a workspace that colcon builds on a robot."""

from __future__ import annotations

import ast
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from srvgen.definitions.names import is_package_name, snake_case
from srvgen.files.search import Search
from taskrpc.errors import TaskRpcError
from taskrpc.ros import workspace
from taskrpc.ros.colcon import programs
from taskrpc.ros.colcon.cmake_package import interface_files
from taskrpc.ros.colcon.manifest import (
    NOT_IN_ROS,
    OURS,
    Manifest,
    checked_name,
    needs_of,
    packages_in,
)
from taskrpc.ros.colcon.python_package import python_files
from taskrpc.ros.colcon.writing import maintainer, write

_LEFT_OUT = re.compile(r"test_.*|.*_test|conftest|setup|noxfile")
_NOT_COPIED = shutil.ignore_patterns("__pycache__", "*.pyc", ".git", "build", "install", "log")


@dataclass
class Exported:
    """The packages that an export has written."""

    folders: dict[str, Path] = field(default_factory=dict)
    """The packages by name, each with its folder in the new workspace."""
    package: str = ""
    """The package of the programs, "" if there are no programs."""
    executables: dict[str, str] = field(default_factory=dict)
    """The executables by name, each with its `module:function`."""
    notes: list[str] = field(default_factory=list)
    """What the user still has to do, one sentence each."""


def export(source: Path, out: Path, name: str = "") -> Exported:
    """Write the packages of a folder below `out/src`.

    Each package of definitions becomes an `ament_cmake` package. The programs beside them become
    one `ament_python` package of the given name. A package that has a `package.xml` is copied.

    Raises TaskRpcError if there is nothing to export or a folder would be overwritten, and
    DefinitionError for a definition that ROS 2 would not build.
    """
    if not source.is_dir():
        raise TaskRpcError(f"expected a folder that contains programs or definitions, got {source}")
    work = _Export(source.resolve(), out.resolve())
    work.look(name)
    work.write()
    return work.done


class _Export:
    """One export: finds the packages, then writes them."""

    def __init__(self, source: Path, out: Path) -> None:
        self.done = Exported()
        self._source = source
        self._out = out
        self._copied: dict[str, Path] = {}
        """The folders of the packages that are copied unchanged."""
        self._files: dict[Path, str] = {}
        """The files to write, with their texts."""
        self._search = Search([source])
        self._user, self._email = maintainer()

    def look(self, name: str) -> None:
        """Find the packages to write."""
        ready = workspace.packages(self._source)
        self._copied = {
            each: folder
            for each, folder in ready.items()
            if folder.is_relative_to(self._source) and not folder.is_relative_to(self._out)
        }
        modules = {} if self._source in self._copied.values() else _modules(self._source)
        wanted = {one for _, tree in modules.values() for one in programs.imported(tree)}
        for package in self._interfaces(wanted):
            self._add_interfaces(package)
        if any("rclpy" in programs.imported(tree) for _, tree in modules.values()):
            self._add_programs(name or self._name_of_programs(), modules)
        self.done.folders |= {each: self._out / "src" / each for each in self._copied}
        if not self.done.folders:
            raise TaskRpcError(
                f"nothing to export in {self._source}: no program that imports rclpy, no package"
                " of definitions (PACKAGE/srv/NAME.srv), no package.xml"
            )

    def write(self) -> None:
        """Write all packages, or none if one of them cannot be written."""
        for folder in self.done.folders.values():
            if folder.exists():
                raise TaskRpcError(f"{folder} already exists: remove it, or name another folder")
        for source in self._copied.values():
            if self._out.is_relative_to(source):
                raise TaskRpcError(f"{self._out} is inside package {source}: name another folder")
        for name, source in self._copied.items():
            shutil.copytree(source, self.done.folders[name], ignore=_NOT_COPIED)
        for path, text in self._files.items():
            write(path, text)

    def _interfaces(self, wanted: Iterable[str]) -> list[str]:
        """The packages of definitions in the folder, and those of taskrpc that programs import."""
        here = [
            package
            for package, folders in self._search.packages().items()
            if folders[0].is_relative_to(self._source) and package not in self._copied
        ]
        ours = {package for package in wanted if package in NOT_IN_ROS}
        return sorted({*here, *ours} - set(self._copied))

    def _add_interfaces(self, package: str) -> None:
        checked_name(package)
        names = self._search.interfaces(package)
        definitions = [self._search.with_dependencies(name)[-1] for name in names]
        needs = packages_in(definitions, package)
        paths = [name.partition("/")[2] + "." + name.split("/")[1] for name in names]
        home = self._new_folder(package)
        for name, path in zip(names, paths, strict=True):
            self._files[home / path] = self._search.text(name)
        manifest = Manifest(
            name=package,
            build_type="ament_cmake",
            maintainer=self._user,
            email=self._email,
            description=f"Interfaces of {package}",
            depends=tuple(needs),
            has_interfaces=True,
            is_linted=False,
        )
        for path, text in interface_files(manifest, paths).items():
            self._files[home / path] = text
        for need in set(needs) & NOT_IN_ROS - set(self.done.folders):
            self._add_interfaces(need)

    def _add_programs(self, name: str, modules: dict[str, tuple[str, ast.Module]]) -> None:
        home = self._new_folder(checked_name(name))
        self.done.package = name
        runnable = [each for each, (_, tree) in modules.items() if _is_node(tree)]
        entries = {each: programs.target(modules[each][1], name, each) for each in runnable}
        self.done.executables = entries
        for each, (text, _) in modules.items():
            changed = programs.as_module(text, name, set(modules))
            self._files[home / name / f"{each}.py"] = changed
        if started := [each for each in entries if f".{programs.STARTER}:" in entries[each]]:
            text = programs.starter(name, started)
            self._files[home / name / f"{programs.STARTER}.py"] = text
        for path, text in python_files(self._manifest(name, modules), entries).items():
            self._files[home / path] = text

    def _manifest(self, name: str, modules: dict[str, tuple[str, ast.Module]]) -> Manifest:
        wanted = {one for _, tree in modules.values() for one in programs.imported(tree)}
        needs = needs_of(wanted, set(self._search.packages()), set(modules))
        self.done.notes += [_note(module) for module in needs.unknown]
        return Manifest(
            name=name,
            build_type="ament_python",
            maintainer=self._user,
            email=self._email,
            description=f"Programs of {self._source.name}",
            exec_depends=tuple(needs.packages),
            is_linted=False,
        )

    def _new_folder(self, package: str) -> Path:
        self.done.folders[package] = self._out / "src" / package
        return self.done.folders[package]

    def _name_of_programs(self) -> str:
        name = snake_case(self._source.name)
        name = name if is_package_name(name) else "programs"
        taken = name in self.done.folders or self._search.has_package(name)
        return f"{name}_programs" if taken or name in {"test", "rclpy"} else name


def _modules(folder: Path) -> dict[str, tuple[str, ast.Module]]:
    """The Python modules of a folder by name, each with its text and syntax tree."""
    found = {}
    for path in sorted(folder.glob("*.py")):
        if _LEFT_OUT.fullmatch(path.stem):
            continue
        if not path.stem.isidentifier():
            raise TaskRpcError(f"{path}: ROS 2 cannot import {path.stem!r}: rename the file")
        try:
            text = path.read_text(encoding="utf-8-sig")
            found[path.stem] = (text, ast.parse(text))
        except (SyntaxError, ValueError) as error:
            line = getattr(error, "lineno", None) or 1
            raise TaskRpcError(f"{path}:{line}: Python cannot read it: {error}") from None
    return found


def _is_node(tree: ast.Module) -> bool:
    return "rclpy" in programs.imported(tree) and programs.is_program(tree)


def _note(module: str) -> str:
    if module in OURS:
        return (
            f"{module} is imported, and ROS 2 does not have it: run taskrpc graduate, or install"
            " taskrpc on the robot"
        )
    return f"{module} is imported: install it on the robot, and add its rosdep key to package.xml"
