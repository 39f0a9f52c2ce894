"""Programs and modules of a package are read from its setup files without executing them."""

import pytest

from taskrpc.ros import installed


@pytest.mark.parametrize(
    "scripts",
    [
        "['talker = pkg.talker:main', 'listener=pkg.sub.listener:Listener.main [extra]']",
        "[f'talker = {package_name}.talker:main', "
        "'listener = ' + package_name + '.sub.listener:Listener.main']",
        "'''\ntalker = pkg.talker:main\nlistener = pkg.sub.listener:Listener.main\n'''",
        "scripts",
    ],
)
def test_entry_points_are_read_from_setup_py_without_executing_it(tmp_path, scripts):
    (tmp_path / "setup.py").write_text(
        "from setuptools import setup\n"
        "raise SystemExit('never executed')\n"
        "package_name = 'pkg'\n"
        "scripts = ['talker = pkg.talker:main',\n"
        "           'listener = pkg.sub.listener:Listener.main']\n"
        "setup(name=package_name, entry_points={'other': [], 'console_scripts': "
        f"{scripts}}}, data_files=[(x, glob()) for x in y])\n"
    )
    assert installed.entry_points(tmp_path) == {
        "talker": "pkg.talker:main",
        "listener": "pkg.sub.listener:Listener.main",
    }


def test_entry_points_of_setup_cfg_and_pyproject_count_too(tmp_path):
    (tmp_path / "setup.py").write_text("from setuptools import setup\nsetup()\n")
    (tmp_path / "setup.cfg").write_text(
        "[options.entry_points]\nconsole_scripts =\n  a = pkg.a:main\n"
    )
    (tmp_path / "pyproject.toml").write_text(
        "[project.scripts]\nb = 'pkg.b:main'\n"
        "[project.entry-points.console_scripts]\nc = 'pkg.c:main'\n"
    )
    found = {name: f"pkg.{name}:main" for name in "abc"}
    assert installed.entry_points(tmp_path) == found


@pytest.mark.parametrize(
    ("setup_py", "setup_cfg"),
    [
        ("setup(package_dir={'': 'src'})", ""),
        ("setup()", "[options]\npackages = find:\npackage_dir =\n    = src\n"),
    ],
)
def test_python_packages_may_lie_in_a_folder_of_their_package(tmp_path, setup_py, setup_cfg):
    (tmp_path / "setup.py").write_text(setup_py)
    (tmp_path / "setup.cfg").write_text(setup_cfg)
    assert installed.source_folder(tmp_path) == tmp_path
    (tmp_path / "src").mkdir()
    assert installed.source_folder(tmp_path) == tmp_path / "src"


@pytest.mark.parametrize("text", ["def (", "entry_points = 1", "setup(entry_points=read())", "\0"])
def test_a_setup_py_that_cannot_be_read_has_no_entry_points(tmp_path, text):
    (tmp_path / "setup.py").write_text(text)
    (tmp_path / "setup.cfg").write_text("[[[")
    (tmp_path / "pyproject.toml").write_text("= =")
    assert installed.entry_points(tmp_path) == {}


def test_scripts_of_a_cmake_package_are_python_files(tmp_path):
    (tmp_path / "scripts").mkdir()
    for name, text in (("a.py", ""), ("b", "#!/usr/bin/env python3\n"), ("c", "#!/bin/sh\n")):
        (tmp_path / "scripts" / name).write_text(text)
    found = [installed.script(tmp_path, name) for name in ("a.py", "b", "c", "d")]
    assert found == [tmp_path / "scripts" / "a.py", tmp_path / "scripts" / "b", None, None]


@pytest.mark.parametrize("inner", ["src", "python"])
def test_python_of_a_cmake_package_may_lie_in_a_folder(tmp_path, inner):
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "main.cpp").touch()
    assert installed.source_folder(tmp_path) == tmp_path
    (tmp_path / inner / "pkg").mkdir(parents=True)
    (tmp_path / inner / "pkg" / "__init__.py").touch()
    assert installed.source_folder(tmp_path) == tmp_path / inner
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg" / "__init__.py").touch()
    assert installed.source_folder(tmp_path) == tmp_path
