"""What keeps colcon from building a package, or ros2 from finding what it has."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

from taskrpc.graduation.program import Finding
from taskrpc.ros import cmake, executables

Found: TypeAlias = "Iterator[tuple[Path, Finding]]"

_GENERATED = ("msg", "srv", "action")
_INSTALLED = ("launch", "config", "params", "urdf", "rviz", "worlds")
_GROUP = "rosidl_interface_packages"


def building(package: Path, manifest: str) -> Found:
    """What is missing in the files around programs and definitions.

    Args:
        package: its folder.
        manifest: the text of its `package.xml`. Raises ParseError where it is not XML.
    """
    root = ElementTree.fromstring(manifest.encode())
    name = (root.findtext("name") or "").strip()
    kind = (root.findtext("export/build_type") or "").strip()
    xml = package / "package.xml"
    if not kind:
        yield (
            xml,
            _finding(
                "there is no build_type",
                "colcon takes it for a package of ROS 1",
                "add <export><build_type>ament_python</build_type></export>, or ament_cmake",
            ),
        )
    if kind == "ament_python":
        yield from _python(package, name)
    if kind == "ament_cmake":
        yield from _cmake(package, root)


def _python(package: Path, name: str) -> Found:
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
                "make an empty one, and name it in data_files",
            ),
        )
    told = re.search(r"install[-_]scripts", _text(package / "setup.cfg") + _text(setup))
    if executables.entry_points(package) and told is None:
        folder = f"$base/lib/{name}"
        yield (
            setup,
            _finding(
                "setup.cfg does not say where executables go",
                "ros2 run finds no executable",
                f"write there [develop] script_dir={folder} and [install] install_scripts={folder}",
            ),
        )
    yield from _not_installed(package, setup, "data_files of setup.py")


def _cmake(package: Path, root: ElementTree.Element) -> Found:
    path = package / "CMakeLists.txt"
    text = re.sub(r"#.*", "", _text(path))
    definitions = [
        one.relative_to(package).as_posix()
        for kind in _GENERATED
        for one in sorted((package / kind).rglob(f"*.{kind}"))
    ]
    is_listed = re.search(r"\bfile\s*\(\s*GLOB", text, re.IGNORECASE) is not None
    for each in definitions:
        if each not in text and not is_listed:
            yield (
                path,
                _finding(
                    f"{each} is not built",
                    "its import is an ImportError",
                    f'add "{each}" to rosidl_generate_interfaces',
                ),
            )
    if definitions and _GROUP not in [each.text for each in root.findall("member_of_group")]:
        yield (
            package / "package.xml",
            _finding(
                "a package of definitions that does not say so",
                "colcon build fails",
                f"add <member_of_group>{_GROUP}</member_of_group>",
            ),
        )
    installed = cmake.programs(package).values()
    for script in sorted((package / "scripts").glob("*.py")):
        is_node = re.search(r"^(import|from) rclpy\b", _text(script), re.MULTILINE) is not None
        if is_node and script not in installed and "scripts/" not in _directories(text):
            inner = script.relative_to(package).as_posix()
            yield (
                path,
                _finding(
                    f"{inner} is not installed",
                    "ros2 run does not find it",
                    f"add install(PROGRAMS {inner} DESTINATION lib/${{PROJECT_NAME}})",
                ),
            )
    yield from _not_installed(package, path, "install(DIRECTORY … DESTINATION share/…)")


def _directories(text: str) -> str:
    """What `install(DIRECTORY …)` names, each with a slash behind it."""
    found = re.findall(r"\binstall\s*\(\s*DIRECTORY\s([^()]*?)\sDESTINATION", text, re.IGNORECASE)
    return " ".join(f"{word.rstrip('/')}/" for words in found for word in words.split())


def _not_installed(package: Path, path: Path, where: str) -> Found:
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
    return Finding(1, 1, what, ros, fix)
