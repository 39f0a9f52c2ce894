"""The lecturer's own checks."""

import pytest

from taskrpc import TaskRpcError
from taskrpc.course.labs.catalogue import lab
from taskrpc.course.labs.hidden import hidden_checks, with_checks

CHECKS = """
from taskrpc.course.labs.lab import Check
async def run(trial): pass
CHECKS = (Check("more", 2, run),)
"""


def written(folder, text):
    (folder / "lab1").mkdir()
    (folder / "lab1/hidden.py").write_text(text)
    return folder


def test_hidden_checks_follow_those_of_the_lab(tmp_path):
    more = hidden_checks(written(tmp_path, CHECKS), lab(1))
    assert [each.title for each in with_checks(lab(1), more).checks][-2:] == [
        lab(1).checks[-1].title,
        "more",
    ]


def test_a_folder_without_checks_for_this_lab_adds_none(tmp_path):
    assert hidden_checks(tmp_path, lab(1)) == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [("CHECKS = 1", "TypeError"), ("CHECKS = (1,)", "Check objects"), ("x = (", "SyntaxError")],
)
def test_a_mistake_in_the_file_is_named(tmp_path, text, words):
    with pytest.raises(TaskRpcError, match=words):
        hidden_checks(written(tmp_path, text), lab(1))


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(TaskRpcError, match="--hidden: expected a folder"):
        hidden_checks(tmp_path / "none", lab(1))
