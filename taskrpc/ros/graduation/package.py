"""What a package lacks, so that colcon cannot build it, or ros2 does not find its programs."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

from srvgen.files.reading import KINDS
from taskrpc.ros import cmake, installed
from taskrpc.ros.colcon.programs import main_function
from taskrpc.ros.graduation.program import Finding, Program, finding_at

Found: TypeAlias = "Iterator[tuple[Path, Finding]]"

_DEPENDS = ("depend", "exec_depend", "build_depend", "run_depend", "test_depend")
_INSTALLED = ("launch", "config", "params", "urdf", "rviz", "worlds")
"""Folders that programs read through `get_package_share_directory`."""
_GROUP = "rosidl_interface_packages"

NO_MANIFEST = Finding(
    1,
    1,
    "there is no package.xml beside it",
    "colcon builds no package of ROS 2 from it",
    "add one, as taskrpc pkg create writes it",
)
"""The finding for a package that has only a `setup.py`."""


def build_problems(package: Path, manifest: ElementTree.Element) -> Found:
    """What is missing in the files around programs and definitions.

    Args:
        package: the package's folder.
        manifest: the root of its `package.xml`.
    """
    name = (manifest.findtext("name") or "").strip()
    build_type = (manifest.findtext("export/build_type") or "").strip()
    if not build_type:
        yield (
            package / "package.xml",
            _finding(
                "there is no build_type",
                "colcon treats the package as one of ROS 1",
                "add <export><build_type>ament_python</build_type></export>, or ament_cmake",
            ),
        )
    if build_type == "ament_python":
        yield from _ament_python(package, name)
    if build_type == "ament_cmake":
        yield from _ament_cmake(package, manifest)


def missing_dependencies(
    needs: Collection[str], manifest: ElementTree.Element
) -> Iterator[Finding]:
    """The packages that programs import and `package.xml` does not name."""
    known = {(each.text or "").strip() for each in manifest if each.tag in _DEPENDS}
    for need in sorted(set(needs) - known):
        yield _finding(
            f"{need} is imported, and not named here",
            "another computer does not install it: ModuleNotFoundError",
            f"add <exec_depend>{need}</exec_depend>",
        )


def missing_entry_point(
    program: Program, module: str, targets: Mapping[str, str]
) -> Iterator[Finding]:
    """The entry point that a program with a `main` needs.

    Args:
        program: the program.
        module: its full name, `package.module`.
        targets: the executables of its package, each with its `module:function`.
    """
    main = main_function(program.tree)
    if main is not None and not any(each.partition(":")[0] == module for each in targets.values()):
        name = module.rpartition(".")[2]
        yield finding_at(
            main,
            f"{module} has a main and no entry point in setup.py",
            "ros2 run does not find it",
            f"add '{name} = {module}:main' to console_scripts",
        )


def _ament_python(package: Path, name: str) -> Found:
    setup = package / "setup.py"
    if not setup.is_file():
        yield (
            package / "package.xml",
            _finding(
                "an ament_python package without setup.py",
                "colcon cannot build it",
                "add one, as taskrpc pkg create --build-type ament_python writes it",
            ),
        )
        return
    if not (package / "resource" / name).is_file():
        yield (
            setup,
            _finding(
                f"there is no file resource/{name}",
                "ros2 does not know the package",
                "create it as an empty file, and name it in data_files",
            ),
        )
    settings = _text(package / "setup.cfg") + _text(setup)
    has_folder = re.search(r"install[-_]scripts", settings) is not None
    if installed.entry_points(package) and not has_folder:
        folder = f"$base/lib/{name}"
        yield (
            setup,
            _finding(
                "setup.cfg does not name the folder for executables",
                "ros2 run finds no executable",
                f"write there [develop] script_dir={folder} and [install] install_scripts={folder}",
            ),
        )
    yield from _folders_not_installed(package, setup, "data_files of setup.py")


def _ament_cmake(package: Path, manifest: ElementTree.Element) -> Found:
    path = package / "CMakeLists.txt"
    definitions = _definitions(package)
    named = {word for _, arguments in cmake.commands(package) for word in arguments}
    for each in definitions:
        if each not in named and str(package / each) not in named:
            yield (
                path,
                _finding(
                    f"{each} is not built",
                    "its import is an ImportError",
                    f'add "{each}" to rosidl_generate_interfaces',
                ),
            )
    if definitions and _GROUP not in [each.text for each in manifest.findall("member_of_group")]:
        yield (
            package / "package.xml",
            _finding(
                "a package of definitions that does not say so",
                "colcon build fails",
                f"add <member_of_group>{_GROUP}</member_of_group>",
            ),
        )
    yield from _scripts_not_installed(package, path)
    yield from _folders_not_installed(package, path, "install(DIRECTORY … DESTINATION share/…)")


def _definitions(package: Path) -> list[str]:
    return [
        one.relative_to(package).as_posix()
        for kind in KINDS
        for one in sorted((package / kind).rglob(f"*.{kind}"))
    ]


def _scripts_not_installed(package: Path, path: Path) -> Found:
    programs = cmake.programs(package).values()
    folders = {
        item.rstrip("/")
        for each in cmake.installations(package)
        if each.kind == "DIRECTORY"
        for item in each.items
    }
    for script in sorted((package / "scripts").glob("*.py")):
        is_node = re.search(r"^(import|from) rclpy\b", _text(script), re.MULTILINE) is not None
        if is_node and script not in programs and "scripts" not in folders:
            inner = script.relative_to(package).as_posix()
            yield (
                path,
                _finding(
                    f"{inner} is not installed",
                    "ros2 run does not find it",
                    f"add install(PROGRAMS {inner} DESTINATION lib/${{PROJECT_NAME}})",
                ),
            )


def _folders_not_installed(package: Path, path: Path, where: str) -> Found:
    text = _text(path)
    for folder in _INSTALLED:
        inner = package / folder
        if inner.is_dir() and any(inner.iterdir()) and folder not in text:
            yield (
                path,
                _finding(
                    f"the folder {folder} is not installed",
                    "get_package_share_directory leads to a folder without it",
                    f"name it in {where}",
                ),
            )


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _finding(what: str, ros: str, fix: str) -> Finding:
    """A finding about a whole file."""
    return Finding(1, 1, what, ros, fix)
