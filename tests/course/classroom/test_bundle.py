"""The bundle as a folder: its parts, what is left out, and places that cannot take it."""

from __future__ import annotations

import shutil
from collections import namedtuple
from pathlib import Path

import msgspec
import pytest

from taskrpc.course.classroom import bundle
from taskrpc.course.classroom.bundle import check_bundle, make_bundle
from taskrpc.course.classroom.checksums import write_sums
from taskrpc.course.classroom.wheels import Wanted
from taskrpc.errors import TaskRpcError
from tests.course.classroom.test_wheels import Pip

Usage = namedtuple("Usage", "total used free")
SMALL = Wanted(["linux"], ["3.12"])


def browser_lab(folder, report):
    place = folder / "browser-lab"
    place.mkdir(exist_ok=True)
    return place


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A checkout with a page, a sheet and a notebook."""
    root = tmp_path / "checkout"
    for name in ("docs/README.md", "docs/teach/lab-1.md", "docs/teach/notebooks/lab-1.ipynb"):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    monkeypatch.setattr(bundle, "source", lambda: root)
    return root


def make(folder, wanted=SMALL, lab=browser_lab):
    said = []
    return make_bundle(folder, wanted, said.append, pip=Pip(), browser_lab=lab), said


def test_bundle_has_wheels_pages_docs_labs_and_notebooks(checkout, tmp_path):
    missing, said = make(tmp_path / "stick" / "taskrpc")
    folder = tmp_path / "stick" / "taskrpc"
    assert {path.name for path in folder.iterdir()} == {
        *("START-HERE.html", "install-linux.html", "labs.html", "bundle.json"),
        *("wheels", "docs", "notebooks", "browser-lab"),
    }
    labs = (folder / "labs.html").read_text(encoding="utf-8")
    assert '<a href="docs/teach/lab-1.md">1. ' in labs
    start = (folder / "START-HERE.html").read_text(encoding="utf-8")
    assert 'href="docs/README.md"' in start
    assert missing == [
        "documentation as web pages: it is there as Markdown; `make site` first",
    ]
    assert said[0] == "taskrpc's own wheel"


def test_documentation_site_is_used_if_it_is_built(checkout, tmp_path):
    for name in ("index.html", "teach/lab-1/index.html"):
        path = checkout / "build" / "site" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    missing, _ = make(tmp_path / "stick")
    assert missing == []
    labs = (tmp_path / "stick" / "labs.html").read_text(encoding="utf-8")
    assert '<a href="docs/teach/lab-1/index.html">1. ' in labs


def test_bundle_that_is_made_again_replaces_its_parts(checkout, tmp_path):
    make(tmp_path / "stick")
    (checkout / "docs" / "README.md").write_text("new")
    make(tmp_path / "stick")
    assert (tmp_path / "stick" / "docs" / "README.md").read_text() == "new"


def test_installed_taskrpc_names_the_parts_that_it_does_not_have(tmp_path, monkeypatch):
    monkeypatch.setattr(bundle, "source", lambda: None)

    def no_lab(folder, report):
        raise TaskRpcError("no network")

    missing, _ = make(tmp_path, lab=no_lab)
    assert [line.partition(":")[0] for line in missing] == [
        "documentation, lab sheets and notebooks",
        "the labs in the browser",
    ]
    assert "no network" in missing[1]
    assert "browser-lab" not in (tmp_path / "START-HERE.html").read_text(encoding="utf-8")


def test_place_with_too_little_space_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(0, 0, 12_000_000))
    with pytest.raises(TaskRpcError) as raised:
        make(tmp_path / "stick", Wanted())
    assert str(raised.value) == (
        f"{tmp_path / 'stick'} has 12 MB free, and the bundle needs 200 MB: use a larger stick, or"
        " fewer versions with --python and --system"
    )


def test_write_protected_stick_is_one_line(tmp_path, monkeypatch):
    def refuse(path, *_, **__):
        raise OSError(30, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "touch", refuse)
    with pytest.raises(TaskRpcError) as raised:
        make(tmp_path / "stick")
    assert str(raised.value) == (
        f"{tmp_path / 'stick'} cannot be written (Read-only file system): is the stick"
        " write-protected, or does the folder belong to another user?"
    )


def test_file_instead_of_a_folder_is_one_line(tmp_path):
    (tmp_path / "stick").touch()
    with pytest.raises(TaskRpcError, match="stick: expected a folder, found a file"):
        make(tmp_path / "stick")


def test_check_takes_the_systems_and_pythons_of_the_bundle(checkout, tmp_path):
    make(tmp_path / "stick", Wanted(["linux"], ["3.12", "3.13"], jupyter=True))
    wheels = tmp_path / "stick" / "wheels"
    (wheels / "taskrpc-0.1.0-py3-none-any.whl").unlink()  # not a real one
    write_sums(wheels)
    pip = Pip()
    assert check_bundle(tmp_path / "stick", print, pip) == 4
    assert [what for what, _ in pip.calls] == [
        *("Linux, Python 3.12", "Linux, Python 3.13"),
        *("Linux (ARM), Python 3.12", "Linux (ARM), Python 3.13"),
    ]
    assert pip.calls[0][1][-1] == "notebook"


@pytest.mark.parametrize("content", [None, b"{", b'{"version": 1}'])
def test_check_of_another_folder_is_one_line(tmp_path, content):
    if content is not None:
        (tmp_path / "bundle.json").write_bytes(content)
    with pytest.raises(TaskRpcError, match="expected a complete bundle, found none"):
        check_bundle(tmp_path, print)


def test_check_finds_a_missing_start_page(checkout, tmp_path):
    make(tmp_path)
    (tmp_path / "START-HERE.html").unlink()
    with pytest.raises(TaskRpcError, match=r"START-HERE\.html is missing; make the bundle again"):
        check_bundle(tmp_path, print, Pip())


def test_about_file_says_what_the_bundle_is_for(checkout, tmp_path):
    make(tmp_path)
    assert msgspec.json.decode((tmp_path / "bundle.json").read_bytes()) == {
        "version": "0.1.0",
        "systems": ["linux"],
        "pythons": ["3.12"],
        "jupyter": False,
    }


def test_check_of_a_bundle_names_a_changed_wheel(checkout, tmp_path):
    make(tmp_path)
    (tmp_path / "wheels" / "taskrpc-0.1.0-py3-none-any.whl").write_bytes(b"another")
    with pytest.raises(TaskRpcError, match=r"taskrpc-0\.1\.0-py3-none-any\.whl has changed"):
        check_bundle(tmp_path, print, Pip())
