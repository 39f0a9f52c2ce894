"""The packages of a workspace are found from a program's folder and from the working directory."""

import pytest

from taskrpc.ros import workspace


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


def test_search_in_a_huge_folder_ends(make, monkeypatch):
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


def test_built_and_ignored_folders_are_left_out(make):
    ws = make("one", "build/two", "not/three", "four")
    (ws / "src" / "not" / "COLCON_IGNORE").touch()
    (ws / "src" / "four" / "AMENT_IGNORE").touch()
    assert list(workspace.packages(ws)) == ["one"]


def test_the_name_is_that_of_the_manifest(make):
    ws = make("folder")
    (ws / "src/folder/package.xml").write_text("<package>\n <name>\n  real_name </name></package>")
    assert workspace.packages(ws) == {"real_name": ws / "src" / "folder"}
