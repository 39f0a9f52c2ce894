"""Copies of folders and ZIP files that students hand in."""

import os
import stat
import sys
import zipfile

import pytest

from taskrpc import TaskRpcError
from taskrpc.course.labs import submission
from taskrpc.course.labs.starter import RECORD
from taskrpc.course.labs.submission import find_lab, find_root, remove, take


def names(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def zipped(path, **files):
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def test_a_folder_is_copied_without_caches_and_environments(tmp_path):
    source = tmp_path / "ada"
    for name in ("server.py", "srv/Add.srv", ".git/x", "__pycache__/y", "venv/pyvenv.cfg"):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text(name)
    assert take(source, tmp_path / "copy") == []
    assert names(tmp_path / "copy") == ["server.py", "srv", "srv/Add.srv"]
    assert (tmp_path / "copy/srv/Add.srv").read_text() == "srv/Add.srv"


@pytest.mark.skipif(sys.platform == "win32", reason="needs links, pipes and such names")
def test_links_and_pipes_are_left_out(tmp_path):
    source = tmp_path / "ada"
    source.mkdir()
    (source / "server.py").symlink_to("/etc/passwd")
    (source / "folder").symlink_to("/etc")
    os.mkfifo(source / "pipe")
    (source / os.fsdecode(b"\xff.py")).write_text("")
    notes = take(source, tmp_path / "copy")
    assert sorted(notes) == [
        "left out folder (a link)",
        "left out pipe (not a file)",
        "left out server.py (a link)",
    ]
    assert len(names(tmp_path / "copy")) == 1


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_named_pipe_is_no_zip_file(tmp_path):
    os.mkfifo(tmp_path / "ada.zip")
    with pytest.raises(TaskRpcError, match=r"expected a folder or a \.zip file"):
        take(tmp_path / "ada.zip", tmp_path / "taken")


def test_a_large_file_is_refused_without_reading_it(tmp_path):
    (tmp_path / "ada").mkdir()
    with (tmp_path / "ada" / "video.mp4").open("wb") as file:
        file.truncate(5 * 2**30)
    with pytest.raises(TaskRpcError, match="expected a submission of at most 20 MB, got more"):
        take(tmp_path / "ada", tmp_path / "copy")


def test_many_files_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(submission, "MOST_FILES", 20)
    (tmp_path / "ada").mkdir()
    for number in range(21):
        (tmp_path / "ada" / f"{number}.py").touch()
    with pytest.raises(TaskRpcError, match="expected a submission of at most 20 files"):
        take(tmp_path / "ada", tmp_path / "copy")


@pytest.mark.parametrize("name", ["../out.py", "/out.py", "a/../../out.py", "C:/out.py", "..\\o"])
def test_names_that_leave_the_folder_are_left_out(tmp_path, name):
    source = zipped(tmp_path / "ada.zip", **{name: "x", "server.py": "y"})
    notes = take(source, tmp_path / "copy")
    assert len(notes) == 1
    assert names(tmp_path / "copy") == ["server.py"]
    assert names(tmp_path) == ["ada.zip", "copy", "copy/server.py"]


def test_a_link_in_a_zip_file_is_left_out(tmp_path):
    info = zipfile.ZipInfo("server.py")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "ada.zip", "w") as archive:
        archive.writestr(info, "/etc/passwd")
    assert take(tmp_path / "ada.zip", tmp_path / "copy") == ["left out server.py (a link)"]
    assert names(tmp_path / "copy") == []


def test_a_zip_file_that_becomes_too_large_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "ada.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zeros", bytes(21 * 2**20))
    assert (tmp_path / "ada.zip").stat().st_size < 2**20
    with pytest.raises(TaskRpcError, match="at most 20 MB"):
        take(tmp_path / "ada.zip", tmp_path / "copy")


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"no archive" * 9])
def test_a_damaged_zip_file_is_named(tmp_path, data):
    (tmp_path / "ada.zip").write_bytes(data)
    with pytest.raises(TaskRpcError, match=r"ada\.zip is no readable ZIP file"):
        take(tmp_path / "ada.zip", tmp_path / "copy")


def test_files_may_be_in_a_folder_of_the_zip_file(tmp_path):
    take(zipped(tmp_path / "a.zip", **{"lab1/server.py": "x"}), tmp_path / "copy")
    assert find_root(tmp_path / "copy", ["server.py", "client.py"]) == tmp_path / "copy/lab1"


def test_of_several_folders_none_is_chosen(tmp_path):
    take(zipped(tmp_path / "a.zip", **{"a/server.py": "", "b/server.py": ""}), tmp_path / "copy")
    assert find_root(tmp_path / "copy", ["server.py"]) == tmp_path / "copy"


def labs(folder, **numbers):
    for name, number in numbers.items():
        (folder / name).mkdir(parents=True)
        (folder / name / RECORD).write_text(f'{{"lab": {number}, "variant": ""}}')


def test_of_several_labs_the_wanted_one_is_checked(tmp_path):
    labs(tmp_path, first=1, second=2)
    assert find_lab(tmp_path, 2) == tmp_path / "second"


def test_a_submission_with_one_lab_is_taken_as_it_is(tmp_path):
    labs(tmp_path, ada=1)
    assert find_lab(tmp_path, None) == find_lab(tmp_path, 2) == tmp_path


@pytest.mark.parametrize(("wanted", "what"), [(None, "a lab"), (3, "lab 3"), (2, "lab 2")])
def test_several_labs_are_named_if_none_can_be_chosen(tmp_path, wanted, what):
    labs(tmp_path, old=2, one=1, two=2)
    expected = f"expected one folder of {what}, got lab 2 in old, lab 1 in one, lab 2 in two: name"
    with pytest.raises(TaskRpcError, match=expected):
        find_lab(tmp_path, wanted)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such deep folders")
def test_a_very_deep_folder_can_be_removed(tmp_path):
    here = os.open(tmp_path, os.O_RDONLY)
    place = here
    for _ in range(3000):
        os.mkdir("d", dir_fd=place)
        below = os.open("d", os.O_RDONLY, dir_fd=place)
        os.close(place)
        place = below
    os.close(place)
    (tmp_path / "locked").mkdir(mode=0o000)
    remove(tmp_path)
    assert not tmp_path.exists()
