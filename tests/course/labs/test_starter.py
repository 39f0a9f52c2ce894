"""The starter files of a lab."""

import re

import pytest

from taskrpc.course.labs.catalogue import LABS, lab
from taskrpc.course.labs.starter import read_record, starter_files, write_starter
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import TaskRpcError


@pytest.mark.parametrize("each", LABS, ids=lambda each: f"lab{each.number}")
@pytest.mark.parametrize("id", ["", "ada", "grace"])
def test_starter_files_are_complete_and_compile(each, id):
    for name, text in starter_files(each, Variant(id)).items():
        assert not re.search("@[A-Z_]+@", name + text), f"a placeholder is left in {name}"
        if name.endswith(".py"):
            compile(text, name, "exec")


def test_folder_remembers_its_lab_and_variant(tmp_path):
    paths = write_starter(lab(1), Variant("ada"), tmp_path)
    assert {path.name for path in paths} == {"server.py", "client.py"}
    assert read_record(tmp_path) == (1, "ada")


def test_files_of_a_student_are_never_overwritten(tmp_path):
    (tmp_path / "client.py").write_text("my work")
    with pytest.raises(TaskRpcError, match=r"client\.py exists already: start the lab in an empty"):
        write_starter(lab(1), Variant(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["client.py"]


@pytest.mark.parametrize(
    "text",
    [
        *("{", "[]", "1", '{"lab": 1}', '{"lab": 1e999, "variant": ""}', "[" * 100_000),
        '{"lab": 1, "variant": "\\ud800"}',
    ],
)
def test_damaged_record_is_named(text, tmp_path):
    (tmp_path / "taskrpc-lab.json").write_text(text)
    with pytest.raises(TaskRpcError, match=r"taskrpc-lab\.json is damaged .* write it anew"):
        read_record(tmp_path)


def test_unknown_lab_is_refused_with_the_known_ones():
    with pytest.raises(TaskRpcError, match=r"there is no lab 9; expected one of 1 \(A first serv"):
        lab(9)
