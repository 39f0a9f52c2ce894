"""The catalogue of scenes: every scene is complete, and its lines are in its programs."""

import ast

import pytest

from taskrpc import TaskRpcError
from taskrpc.course.scenes.catalogue import SCENES, scene
from taskrpc.course.scenes.player import PROGRAMS, excerpt, program_path

EACH = pytest.mark.parametrize("each", SCENES, ids=lambda each: each.name)
NAMES = """lost-reply late-answer retry-without-id timeout-too-short deadlock nobody-spins
forgot-return wrong-type two-servers eleven-calls same-box"""


def test_the_scenes_have_the_order_of_the_lecture():
    assert [each.name for each in SCENES] == NAMES.split()


def test_each_folder_of_programs_belongs_to_a_scene():
    assert {path.name for path in PROGRAMS.iterdir()} == {each.name for each in SCENES}


def test_unknown_scene_is_named_with_the_known_ones():
    with pytest.raises(TaskRpcError, match="no scene 'deadlok'; expected one of lost-reply, "):
        scene("deadlok")


@EACH
@pytest.mark.parametrize("cure", [False, True], ids=["problem", "cure"])
def test_excerpts_are_in_the_programs(each, cure):
    program = program_path(each, cure=cure).read_text(encoding="utf-8")
    ast.parse(program)
    lines = excerpt(each, cure=cure).lines(program)
    assert len(lines) <= 8
    assert any(line.is_marked for line in lines)


@EACH
def test_texts_are_short_sentences(each):
    for text in (each.sees, each.ros, each.why, each.cure):
        assert text.endswith(".")
        assert len(text) <= 140
    assert len(each.sees) <= 70
    assert len(each.ros) <= 72
