"""Packages of a workspace are found from wherever a program of it lies or is started."""

import pytest

from taskrpc.ros import installed, workspace


@pytest.fixture
def make(tmp_path):
    """Write files of a workspace."""

    def make(*packages, **files):
        for package in packages:
            folder = tmp_path / "ws" / "src" / package
            folder.mkdir(parents=True)
            (folder / "package.xml").write_text(f"<package><name>{folder.name}</name></package>")
        return tmp_path / "ws"

    return make


def test_packages_are_found_from_the_workspace_its_src_a_package_and_a_file(make):
    ws = make("one", "group/two", "group/deep/three")
    inner = ws / "src" / "one" / "one"
    inner.mkdir()
    for start in (ws, ws / "src", ws / "src" / "one", inner / "node.py", ws / "src/group/two"):
        assert sorted(workspace.packages(start)) == ["one", "three", "two"], start
    assert workspace.roots(ws) == [ws / "src", ws / "src" / "group", ws / "src" / "group" / "deep"]


def test_packages_are_found_at_any_depth_below_src(make):
    deep = "a/b/c/d/e/f/g/h/deep"
    ws = make("one", deep, "one/inside")
    assert workspace.packages(ws) == {"one": ws / "src" / "one", "deep": ws / "src" / deep}
    for start in (ws / "src" / "one", ws / "src" / deep / "nodes"):
        assert sorted(workspace.packages(start)) == ["deep", "one"]


def test_packages_behind_links_are_found_once_and_loops_of_links_end(make, tmp_path, symlink):
    ws = make("one")
    elsewhere = tmp_path / "elsewhere" / "two"
    elsewhere.mkdir(parents=True)
    (elsewhere / "package.xml").write_text("<package><name>two</name></package>")
    symlink(elsewhere.parent / "back", ws)
    symlink(ws / "src" / "linked", elsewhere.parent)
    symlink(ws / "src" / "loop", ws / "src")
    found = workspace._packages_in(ws / "src")
    assert [name for name, _ in found] == ["one", "two"]


def test_a_folder_without_end_is_not_searched_for_ever(make, monkeypatch):
    monkeypatch.setattr(workspace, "_MOST", 20)
    ws = make("zz", *(f"many/{number}/deep/pkg" for number in range(30)))
    assert list(workspace.packages(ws)) == ["zz"]


def test_packages_are_found_from_a_folder_of_packages_in_src(make):
    ws = make("one", "group/two")
    assert sorted(workspace.packages(ws / "src" / "group")) == ["one", "two"]


def test_without_a_workspace_there_are_none(tmp_path):
    assert workspace.packages(tmp_path, tmp_path / "gone") == {}


def test_a_program_s_own_package_needs_no_manifest(tmp_path):
    node = tmp_path / "group" / "nodes" / "nodes" / "server.py"
    node.parent.mkdir(parents=True)
    (node.parent.parent / "setup.py").touch()
    assert workspace.packages(node.parent) == {"nodes": node.parent.parent}
    assert workspace.roots(node.parent) == [tmp_path / "group"]


def test_what_was_built_or_is_ignored_is_left_out(make):
    ws = make("one", "build/two", "not/three", "four")
    (ws / "src" / "not" / "COLCON_IGNORE").touch()
    (ws / "src" / "four" / "AMENT_IGNORE").touch()
    assert list(workspace.packages(ws)) == ["one"]


def test_the_name_is_that_of_the_manifest(make):
    ws = make("folder")
    (ws / "src/folder/package.xml").write_text("<package>\n <name>\n  real_name </name></package>")
    assert workspace.packages(ws) == {"real_name": ws / "src" / "folder"}


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
