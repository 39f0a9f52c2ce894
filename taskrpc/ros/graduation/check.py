"""Checks programs and their packages for what a real ROS 2 would do differently."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from srvgen import DefinitionError
from srvgen.definitions.model import Definition
from srvgen.files.search import Search
from taskrpc.errors import TaskRpcError
from taskrpc.ros import installed, workspace
from taskrpc.ros.colcon import programs
from taskrpc.ros.colcon.manifest import OURS, needs_of
from taskrpc.ros.graduation.api_usage import (
    invalid_names,
    invalid_values,
    start_and_end,
    taskrpc_only,
)
from taskrpc.ros.graduation.blocking import blocking
from taskrpc.ros.graduation.package import (
    NO_MANIFEST,
    build_problems,
    missing_dependencies,
    missing_entry_point,
)
from taskrpc.ros.graduation.program import Finding, Program

_LEFT_OUT = {"build", "install", "log", "node_modules", "test", "tests", "venv", "__pycache__"}


class LocatedFinding(NamedTuple):
    """A finding and the file that it is about."""

    path: Path
    finding: Finding

    def __str__(self) -> str:
        return f"{self.path}:{self.finding.line}:{self.finding.column}: {self.finding}"


def check(path: Path) -> list[LocatedFinding]:
    """The findings for a program, or for all programs and packages in a folder.

    Raises TaskRpcError if a file cannot be read.
    """
    files = [path] if path.is_file() else sorted(_files(path))
    packages: dict[Path, list[Path]] = {}
    if path.is_dir():
        here = path.resolve()
        inner = workspace.packages(here).values()
        packages = {each: [] for each in inner if each.is_relative_to(here)}
    if not files and not packages:
        raise TaskRpcError(f"expected a Python file or a folder that contains programs, got {path}")
    read = {file: _read(file) for file in files}
    found = [LocatedFinding(file, one) for file in files for one in _of_program(file, read[file])]
    for file in files:
        if (package := workspace.package_of(file.resolve())) is not None:
            packages.setdefault(package, []).append(file)
    for package, own in packages.items():
        found += _of_package(package, {file: read[file] for file in own})
    return found


def _files(folder: Path) -> Iterator[Path]:
    for path in folder.rglob("*.py"):
        inner = path.relative_to(folder)
        is_hidden = any(part.startswith(".") or part in _LEFT_OUT for part in inner.parts)
        if not is_hidden and path.name not in ("setup.py", "conftest.py"):
            yield path


def _read(path: Path) -> Program:
    try:
        return Program(ast.parse(path.read_bytes()))
    except OSError as error:
        raise TaskRpcError(f"cannot read {path}: {error.strerror or error}") from None
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None) or 1
        raise TaskRpcError(f"{path}:{line}: Python cannot read it: {error}") from None


def _of_program(path: Path, program: Program) -> list[Finding]:
    found = list(taskrpc_only(program))
    if program.imports_rclpy:
        search = Search([path.resolve().parent, *workspace.roots(path.resolve())])
        found += blocking(program)
        found += start_and_end(program)
        found += invalid_names(program)
        found += invalid_values(program, lambda name: _definition(search, name))
    return sorted(set(found))


def _definition(search: Search, name: str) -> Definition | None:
    try:
        return search.load(name)
    except DefinitionError:
        return None


def _of_package(package: Path, own: dict[Path, Program]) -> list[LocatedFinding]:
    path = package / workspace.MANIFEST
    if not path.is_file():
        return [LocatedFinding(package / "setup.py", NO_MANIFEST)]
    try:
        manifest = ElementTree.fromstring(path.read_bytes())
        found = [LocatedFinding(file, one) for file, one in build_problems(package, manifest)]
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise TaskRpcError(f"cannot read {path}: {error}") from None
    wanted = {name for one in own.values() for name in programs.imported(one.tree)}
    beside = {file.stem for file in own} | {package.name} | OURS
    interfaces = {*Search([*workspace.roots(package)]).packages(), *workspace.packages(package)}
    needs = needs_of(wanted, interfaces, beside)
    found += [LocatedFinding(path, one) for one in missing_dependencies(needs.packages, manifest)]
    return found + _missing_entry_points(package, own)


def _missing_entry_points(package: Path, own: dict[Path, Program]) -> list[LocatedFinding]:
    if not (package / "setup.py").is_file():
        return []
    targets = installed.entry_points(package)
    found = []
    for path, program in own.items():
        inner = path.resolve().relative_to(package).with_suffix("")
        if len(inner.parts) == 2 and programs.is_program(program.tree):
            module = ".".join(inner.parts)
            found += [
                LocatedFinding(path, one) for one in missing_entry_point(program, module, targets)
            ]
    return found
