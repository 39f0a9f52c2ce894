"""`taskrpc pkg create` makes packages as `ros2 pkg create` does."""

import os
import shutil
import subprocess
import sys
from xml.etree import ElementTree

import pytest

from tests.cli.ros.pkg.conftest import _create_python


def test_create_prints_what_ros2_pkg_create_prints(pkg, tmp_path):
    code, out, err = _create_python(pkg)
    assert (code, err) == (0, "")
    folder = os.path.join(".", "my_package")
    inner = os.path.join(folder, "my_package")
    told = out.splitlines()
    assert told[:11] == [
        "going to create a new package",
        "package name: my_package",
        f"destination directory: {tmp_path}",
        "package format: 3",
        "version: 0.0.0",
        "description: TODO: Package description",
        told[6],
        "licenses: ['Apache-2.0']",
        "build type: ament_python",
        "dependencies: ['rclpy', 'example_interfaces']",
        "node_name: my_node",
    ]
    assert told[6].startswith("maintainer: ['Ana & Co <")
    assert told[11:17] == [
        f"creating folder {folder}",
        f"creating {os.path.join(folder, 'package.xml')}",
        "creating source folder",
        f"creating folder {inner}",
        f"creating {os.path.join(folder, 'setup.py')}",
        f"creating {os.path.join(folder, 'setup.cfg')}",
    ]
    assert f"creating {inner}{os.sep}my_node.py" in [each.replace("/", os.sep) for each in told]


def test_created_python_package_has_the_files_of_ament(pkg, tmp_path):
    _create_python(pkg)
    root = ElementTree.parse(tmp_path / "my_package" / "package.xml").getroot()
    assert [each.text for each in root.findall("depend")] == ["rclpy", "example_interfaces"]
    assert root.findtext("maintainer") == "Ana & Co"
    assert root.findtext("export/build_type") == "ament_python"
    files = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    assert {each.replace(os.sep, "/") for each in files} == {
        "my_package/LICENSE",
        "my_package/package.xml",
        "my_package/setup.py",
        "my_package/setup.cfg",
        "my_package/resource/my_package",
        "my_package/my_package/__init__.py",
        "my_package/my_package/my_node.py",
        "my_package/test/test_copyright.py",
        "my_package/test/test_flake8.py",
        "my_package/test/test_pep257.py",
    }
    for path in tmp_path.rglob("*.py"):
        compile(path.read_text(), str(path), "exec")


@pytest.mark.real_time
def test_created_package_runs_unchanged(pkg, tmp_path):
    _create_python(pkg)
    done = subprocess.run(
        [sys.executable, "-m", "taskrpc", "run", "my_package", "my_node"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("Hi from my_package.\n", "")


def test_created_cmake_package_finds_and_links_its_dependencies(pkg, tmp_path):
    code, out, _ = pkg("create", "lamp", "--node-name", "shine", "--dependencies", "rclcpp")
    assert code == 0
    assert "[WARNING]: Unknown license 'TODO: License declaration'." in out
    cmake = (tmp_path / "lamp" / "CMakeLists.txt").read_text()
    assert "find_package(rclcpp REQUIRED)\n" in cmake
    assert "add_executable(shine src/shine.cpp)\n" in cmake
    assert cmake.endswith("ament_package()\n")
    assert "hello world lamp package" in (tmp_path / "lamp" / "src" / "shine.cpp").read_text()
    assert (tmp_path / "lamp" / "include" / "lamp").is_dir()
    assert pkg("create", "lamp")[2].startswith("Aborted! The directory already exists: ")


def test_a_created_library_is_built_exported_and_linked(pkg, tmp_path):
    both = ("--node-name", "shine", "--library-name", "bright_light")
    code, out, err = pkg("create", "lamp", "--license", "Apache-2.0", *both)
    assert (code, err) == (0, "")
    told = [line.replace(os.sep, "/") for line in out.splitlines()]
    assert told[10:12] == ["node_name: shine", "library_name: bright_light"]
    assert told[-4:] == [
        "creating ./lamp/src/shine.cpp",
        "creating ./lamp/include/lamp/bright_light.hpp",
        "creating ./lamp/src/bright_light.cpp",
        "creating ./lamp/include/lamp/visibility_control.h",
    ]
    cmake = (tmp_path / "lamp" / "CMakeLists.txt").read_text()
    for line in (
        "find_package(ament_cmake_ros REQUIRED)",
        "add_library(bright_light src/bright_light.cpp)",
        "target_link_libraries(shine bright_light)",
        "ament_export_targets(export_${PROJECT_NAME})",
    ):
        assert f"{line}\n" in cmake
    root = ElementTree.parse(tmp_path / "lamp" / "package.xml").getroot()
    assert [each.text for each in root.findall("buildtool_depend")] == ["ament_cmake_ros"]
    assert (tmp_path / "lamp" / "LICENSE").read_text().lstrip().startswith("Apache License")
    assert "class BrightLight\n" in (tmp_path / "lamp/include/lamp/bright_light.hpp").read_text()


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler is here")
def test_created_cpp_sources_compile(pkg, tmp_path):
    pkg("create", "lamp", "--node-name", "shine", "--library-name", "bright_light")
    sources = [str(path) for path in (tmp_path / "lamp" / "src").iterdir()]
    command = ["g++", "-fsyntax-only", "-Wall", "-Werror", f"-I{tmp_path / 'lamp' / 'include'}"]
    done = subprocess.run([*command, *sources], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_created_python_library_is_a_package_within(pkg, tmp_path):
    kind = ("--build-type", "ament_python", "--license", "MIT", "--maintainer-name", "Ana")
    code, _, err = pkg("create", "lamp", *kind, "--node-name", "light", "--library-name", "light")
    assert (code, err) == (
        0,
        "[WARNING] node name can not be equal to the library name\n"
        "[WARNING] renaming node to light_node\n",
    )
    assert (tmp_path / "lamp" / "lamp" / "light" / "__init__.py").is_file()
    assert (tmp_path / "lamp" / "lamp" / "light_node.py").is_file()
    holder = (tmp_path / "lamp" / "LICENSE").read_text().splitlines()[0]
    assert holder.startswith("Copyright (c) 20")
    assert holder.endswith(" Ana")


def test_licenses(pkg, tmp_path):
    code, out, _ = pkg("create", "x", "--license", "?")
    assert (code, out.splitlines()[:2]) == (0, ["Supported licenses:", "Apache-2.0"])
    assert not (tmp_path / "x").exists()
    for name in ("MIT-0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0"):
        package = f"p{name.lower().replace('-', '_').replace('.', '_')}"
        assert "WARNING" not in pkg("create", package, "--license", name)[1]
        assert "AS IS" in (tmp_path / package / "LICENSE").read_text()
    out = pkg("create", "free", "--license", "GPL-3.0-only")[1]
    assert out.endswith("no LICENSE file has been created: put the license's text there.\n")
    assert not (tmp_path / "free" / "LICENSE").exists()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["lamp", "--library-name", "1st"], "as --library-name, got '1st'"),
        (["My-Package"], "as the name of a package, got 'My-Package'"),
        (["test", "--build-type", "ament_python"], "packages can't be named 'test'"),
        (["lamp", "--node-name", "a b"], "as --node-name, got 'a b'"),
        (["lamp", "--dependencies", "<x>"], "as --dependencies, got '<x>'"),
        (["lamp", "--build-type", "make"], "invalid choice: 'make'"),
    ],
)
def test_invalid_use_of_create_is_one_sentence_and_writes_nothing(
    pkg, tmp_path, arguments, problem
):
    code, out, err = pkg("create", *arguments)
    assert code in (1, 2)
    assert out == ""
    assert problem in err.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []
