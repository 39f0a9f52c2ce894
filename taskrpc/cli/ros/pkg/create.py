"""`taskrpc pkg create`: writes a new package, and prints the lines of `ros2 pkg create`."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from taskrpc.cli.shared.command import Exit
from taskrpc.errors import TaskRpcError
from taskrpc.ros.colcon.cmake_package import cmake_files
from taskrpc.ros.colcon.manifest import Manifest, checked_name
from taskrpc.ros.colcon.python_package import hello_node, python_files
from taskrpc.ros.colcon.writing import LICENSES, license_text, maintainer, write

if TYPE_CHECKING:
    from argparse import Namespace


def create(options: Namespace) -> Exit:
    """Write the package that the options describe. Raises TaskRpcError if that fails."""
    if options.license == "?":
        print("Supported licenses:\n" + "\n".join(LICENSES))
        return Exit.DONE
    package = _manifest(options)
    library = _checked_word("library-name", options.library_name)
    node = _checked_word("node-name", options.node_name)
    folder = os.path.join(options.destination_directory, package.name)
    if os.path.exists(folder):
        raise TaskRpcError(
            f"Aborted! The directory already exists: {folder}; either remove it or choose a"
            " different destination directory or package name"
        )
    if node and node == library:
        node = f"{node}_node"
        print("[WARNING] node name can not be equal to the library name", file=sys.stderr)
        print(f"[WARNING] renaming node to {node}", file=sys.stderr)
    _print_facts(package, options, node, library)
    if package.build_type == "ament_python":
        _write_python(package, folder, node, library)
    else:
        _write_cmake(package, folder, node, library)
    _write_license(package, folder)
    return Exit.DONE


def _write_license(package: Manifest, folder: str) -> None:
    if text := license_text(package.license, package.maintainer):
        write(Path(folder, "LICENSE"), text)
    elif package.license in LICENSES:
        print("\n[WARNING]: no LICENSE file has been created: put the license's text there.")
    else:
        print(
            f"\n[WARNING]: Unknown license '{package.license}'.  This has been set in the"
            " package.xml, but no LICENSE file has been created.\n"
            "It is recommended to use one of the ament license identifiers:\n" + "\n".join(LICENSES)
        )


def _manifest(options: Namespace) -> Manifest:
    checked_name(options.package_name)
    for name in options.dependencies:
        if re.fullmatch(r"[A-Za-z][\w.+-]*", name) is None:
            raise TaskRpcError(f"expected names of packages as --dependencies, got {name!r}")
    if options.build_type == "ament_python" and options.package_name == "test":
        raise TaskRpcError(
            "Aborted since 'ament_python' packages can't be named 'test': the folder of its tests"
            " has this name; choose a different package name"
        )
    name, email = maintainer()
    return Manifest(
        name=options.package_name,
        build_type=options.build_type,
        maintainer=options.maintainer_name or name,
        email=options.maintainer_email or email,
        description=options.description or Manifest.description,
        license=options.license or Manifest.license,
        format=options.package_format,
        depends=tuple(options.dependencies),
    )


def _checked_word(option: str, name: str) -> str:
    if name and re.fullmatch(r"[A-Za-z_]\w*", name, flags=re.ASCII) is None:
        rule = "letters, digits and underscores, not a digit first"
        raise TaskRpcError(f"expected {rule} as --{option}, got {name!r}")
    return name


def _print_facts(package: Manifest, options: Namespace, node: str, library: str) -> None:
    print("going to create a new package")
    print(f"package name: {package.name}")
    print(f"destination directory: {os.path.abspath(options.destination_directory)}")
    print(f"package format: {package.format}")
    print(f"version: {package.version}")
    print(f"description: {package.description}")
    print(f"maintainer: {[f'{package.maintainer} <{package.email}>']}")
    print(f"licenses: {[package.license]}")
    print(f"build type: {package.build_type}")
    print(f"dependencies: {list(package.depends)}")
    if node:
        print(f"node_name: {node}")
    if library:
        print(f"library_name: {library}")


def _write_python(package: Manifest, folder: str, node: str, library: str) -> None:
    name = package.name
    files = python_files(package, {node: f"{name}.{node}:main"} if node else {})
    _make_folder(folder)
    _create(folder, files, "package.xml")
    print("creating source folder")
    _make_folder(folder, name)
    _create(folder, files, "setup.py", "setup.cfg")
    _make_folder(folder, "resource")
    _create(folder, files, f"resource/{name}", f"{name}/__init__.py")
    _make_folder(folder, "test")
    _create(folder, files, *(path for path in files if path.startswith("test/")))
    if node:
        path = f"{name}/{node}.py"
        _create(folder, {path: hello_node(name)}, path)
    if library:
        _make_folder(folder, os.path.join(name, library))
        path = f"{name}/{library}/__init__.py"
        _create(folder, {path: ""}, path)


def _write_cmake(package: Manifest, folder: str, node: str, library: str) -> None:
    files = cmake_files(package, node, library)
    _make_folder(folder)
    _create(folder, files, "package.xml")
    print("creating source and include folder")
    _make_folder(folder, "src")
    _make_folder(folder, f"include/{package.name}")
    _create(folder, files, "CMakeLists.txt")
    if node:
        _create(folder, files, f"src/{node}.cpp")
    if library:
        headers = f"include/{package.name}"
        _create(folder, files, f"{headers}/{library}.hpp", f"src/{library}.cpp")
        _create(folder, files, f"{headers}/visibility_control.h")


def _make_folder(folder: str, inner: str = "") -> None:
    path = os.path.join(folder, inner) if inner else folder
    print(f"creating folder {path}")
    os.makedirs(path, exist_ok=True)


def _create(folder: str, files: dict[str, str], *paths: str) -> None:
    for path in paths:
        print(f"creating {os.path.join(folder, path)}")
        write(Path(folder, path), files[path])
