import json
import shutil

import pytest

from taskrpc.course.labs.catalogue import LABS
from taskrpc.course.notebook.labs import NotebookLab
from taskrpc.errors import TaskRpcError
from tests.notebooks.tidy import NOTEBOOKS, tidy


@pytest.fixture
def lab(tmp_path, monkeypatch):
    ran = []
    monkeypatch.setattr("sys.path", [])
    monkeypatch.setattr("taskrpc.ros.hook.real_rclpy", lambda: "/opt/ros")  # install no hook
    lab = NotebookLab(1, tmp_path, lambda text, path: ran.append((path.name, text)))
    lab.ran = ran
    lab.begin()
    return lab


def test_lab_has_a_folder_with_the_starter_files(lab, tmp_path):
    assert lab.folder == tmp_path / "lab1"
    assert {"server.py", "client.py"} <= {path.name for path in lab.folder.iterdir()}


def test_lab_that_was_begun_keeps_the_students_files(lab):
    lab.write("server.py", "x = 1\n")
    lab.begin()
    assert (lab.folder / "server.py").read_text() == "x = 1\n"


def test_python_file_is_written_and_runs(lab):
    lab.write("server.py", "x = 1\n")
    assert lab.ran == [("server.py", "x = 1\n")]


@pytest.mark.parametrize("name", ["", ".", "a\0b", "../server.py", "/tmp/server.py"])
def test_file_outside_of_the_lab_is_refused(lab, name):
    with pytest.raises(TaskRpcError, match="expected a file of the lab, such as"):
        lab.write(name, "x = 1\n")


def test_file_that_cannot_be_written_is_named(lab):
    with pytest.raises(TaskRpcError, match=r"%%lab: cannot write server\.py/x: \w+"):
        lab.write("server.py/x", "x = 1\n")


def test_definition_belongs_into_the_folder_of_its_package(lab):
    with pytest.raises(TaskRpcError, match=r"expected a definition in PACKAGE/srv/Add\.srv, got"):
        lab.write("Add.srv", "---\n")
    assert not (lab.folder / "Add.srv").exists()


def test_folder_that_is_gone_is_named(lab):
    shutil.rmtree(lab.folder)
    with pytest.raises(TaskRpcError, match=r"lab1 is gone: run the first cell again, which calls"):
        lab.check()


def test_file_in_the_place_of_the_folder_is_named(tmp_path):
    (tmp_path / "lab2").write_text("")
    with pytest.raises(TaskRpcError, match=r"cannot make the folder .*lab2 of the lab: \w+"):
        NotebookLab(2, tmp_path, lambda text, path: None).begin()


def test_program_that_does_not_exist_is_refused(lab):
    with pytest.raises(TaskRpcError, match=r"no file x.py in .*; expected one of client.py and"):
        lab.run("x.py", [])


@pytest.mark.parametrize("each", LABS, ids=lambda each: f"lab{each.number}")
def test_each_lab_has_a_notebook_in_step_with_its_files(each):
    path = NOTEBOOKS / f"lab{each.number}.ipynb"
    text = path.read_text("utf-8")
    remedy = "run `python -m tests.notebooks.tidy` and commit the notebooks"
    assert tidy(each.number, text) == text, remedy
    sources = ["".join(cell["source"]) for cell in json.loads(text)["cells"]]
    shown = {source.partition("\n")[0].removeprefix("%%lab ") for source in sources}
    written = {name for name in each.files if "/" not in name and "@" not in name}
    assert written <= shown, "the notebook lacks a file of the lab"
    assert sum(source == "notebook.check()" for source in sources) == 1
