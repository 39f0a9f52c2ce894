"""The executables and modules that a package installs, read from its build files.

Nothing of the package is executed: `setup.py` is parsed, and CMake does not run.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator, Mapping
from configparser import ConfigParser
from configparser import Error as ConfigError
from pathlib import Path
from typing import Any

from taskrpc.ros import cmake

_PYTHON_BUILDS = ("setup.py", "setup.cfg", "pyproject.toml")
_TESTS = ("test", "tests")
_SOURCE_FOLDERS = ("src", "python")
_SCRIPT_FOLDERS = ("scripts", "nodes", "src", "bin", "")


def executables(package: Path) -> set[str]:
    """The names that `ros2 run` accepts for a package."""
    return {*entry_points(package), *cmake.programs(package)}


def entry_points(package: Path) -> dict[str, str]:
    """The executables of a Python package, by name, each with its `module:function`."""
    found: dict[str, str] = {}
    for read in (_of_setup_py, _of_setup_cfg, _of_pyproject):
        for name, target in read(package):
            found.setdefault(name, target)
    return found


def source_folder(package: Path) -> Path:
    """The folder that contains a package's Python packages: its own, or one such as `src`."""
    for read in (_folder_of_setup_py, _folder_of_setup_cfg):
        folder = package / read(package)
        if folder != package and folder.is_dir():
            return folder
    # CMake packages name it in CMakeLists.txt; ROS 1 packages in a setup.py that only catkin reads.
    named = (package / each for each in _SOURCE_FOLDERS)
    found = (folder for folder in named if any(folder.glob("*/__init__.py")))
    is_plain = any(package.glob("*/__init__.py"))
    return package if is_plain else next(found, package)


def modules(package: Path, name: str) -> dict[str, Path]:
    """The modules that a package of this name installs, each with its file or folder.

    `a.b` is a module in a package `a`, which may have no folder of its own.
    """
    found = cmake.modules(package)
    inner = source_folder(package)
    for value in _keywords(package, "package_dir"):
        if isinstance(value, dict):
            found.update((each, package / str(path)) for each, path in value.items() if each)
    for value in _keywords(package, "py_modules"):
        found.update((each, inner / f"{each}.py") for each in value or ())
    is_python = any((package / each).is_file() for each in _PYTHON_BUILDS)
    for init in sorted(inner.glob("*/__init__.py")):
        folder = init.parent
        if folder.name == name or (is_python and folder.name not in _TESTS):
            found.setdefault(folder.name, folder)
    return {each: path for each, path in found.items() if path.exists()}


def script(package: Path, name: str) -> Path | None:
    """The file that a CMake package installs as an executable of this name, or None."""
    if (installed := cmake.programs(package).get(name)) is not None:
        return installed
    folders = [package / folder for folder in _SCRIPT_FOLDERS] + [package / package.name]
    for folder in folders:
        path = folder / name
        if path.is_file() and cmake.is_python(path):
            return path
    return None


def _of_setup_py(package: Path) -> Iterator[tuple[str, str]]:
    for value in _keywords(package, "entry_points"):
        yield from _pairs(value)


def _folder_of_setup_py(package: Path) -> str:
    for value in _keywords(package, "package_dir"):
        if isinstance(value, dict):
            return str(value.get("", ""))
    return ""


def _keywords(package: Path, name: str) -> Iterator[Any]:
    """The values that `setup.py` passes for a keyword, as far as the source shows them."""
    try:
        tree = ast.parse((package / "setup.py").read_bytes())
    except (OSError, SyntaxError, ValueError):
        return
    known: dict[str, Any] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            known.setdefault(node.targets[0].id, _value(node.value, known))
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == name:
            yield _value(node.value, known)


def _of_setup_cfg(package: Path) -> Iterator[tuple[str, str]]:
    config = _setup_cfg(package)
    if config.has_section("options.entry_points"):
        yield from _pairs(dict(config["options.entry_points"]))


def _folder_of_setup_cfg(package: Path) -> str:
    given = _setup_cfg(package).get("options", "package_dir", fallback="")
    found = re.search(r"^\s*=\s*(\S+)", given, flags=re.MULTILINE)
    return found[1] if found else ""


def _setup_cfg(package: Path) -> ConfigParser:
    config = ConfigParser(interpolation=None)
    try:
        config.read(package / "setup.cfg", encoding="utf-8")
    except (ConfigError, UnicodeDecodeError):
        return ConfigParser()
    return config


def _of_pyproject(package: Path) -> Iterator[tuple[str, str]]:
    try:
        settings = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    project = settings.get("project", {})
    others = project.get("entry-points", {}).get("console_scripts", {})
    scripts = {**others, **project.get("scripts", {})}
    yield from ((name, target) for name, target in scripts.items() if isinstance(target, str))


def _pairs(entry_points: Any) -> Iterator[tuple[str, str]]:
    """The pairs in `console_scripts`: lines `name = module:function`, in a list or one string."""
    if not isinstance(entry_points, dict):
        return
    lines = entry_points.get("console_scripts") or []
    for line in lines.splitlines() if isinstance(lines, str) else lines:
        if found := re.fullmatch(r"\s*(\S+)\s*=\s*([\w.]+:[\w.]+)\s*(?:\[.*\])?", str(line)):
            yield found[1], found[2]


def _value(node: ast.AST | None, known: Mapping[str, Any]) -> Any:
    """The value of an expression of strings, lists and dicts; None for any other expression."""
    found: Any = None
    match node:
        case ast.Constant(value):
            found = value
        case ast.Name(name):
            found = known.get(name)
        case ast.List(items) | ast.Tuple(items):
            found = [_value(item, known) for item in items]
        case ast.Dict(keys, values):
            pairs = zip(keys, values, strict=True)
            found = {_value(key, known): _value(value, known) for key, value in pairs if key}
        case ast.JoinedStr(parts):
            found = "".join(str(_value(part, known)) for part in parts)
        case ast.FormattedValue(inner):
            found = _value(inner, known)
        case ast.BinOp(left, ast.Add(), right):
            found = _sum(_value(left, known), _value(right, known))
    return found


def _sum(left: Any, right: Any) -> Any:
    if isinstance(left, str) and isinstance(right, str):
        return left + right
    return [*left, *right] if isinstance(left, list) and isinstance(right, list) else None
