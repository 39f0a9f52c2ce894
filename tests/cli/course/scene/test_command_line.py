"""`taskrpc scene` lists the scenes and shows their programs; `test_player` plays them."""

import asyncio

import pytest

from taskrpc.cli.course.scene.screen import Screen
from taskrpc.cli.main import main
from taskrpc.course.scenes import player
from taskrpc.course.scenes.catalogue import SCENES
from taskrpc.course.scenes.moments import Moment


@pytest.fixture
def played(monkeypatch):
    """What was played, as (name, cure, like_ros)."""
    seen = []

    async def play(scene, report, *, cure, like_ros):
        seen.append((scene.name, cure, like_ros))
        report(Moment(0.0, "program", f"{scene.name} runs"))

    monkeypatch.setattr(player, "play", play)
    return seen


def test_list_has_names_and_titles(capsys):
    assert main(["scene"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[: len(SCENES)]] == [each.name for each in SCENES]
    assert lines[4] == "deadlock           A callback waits for its own thread"


def test_scene_shows_problem_and_cure(capsys, played):
    assert main(["scene", "deadlock"]) == 0
    assert played == [("deadlock", False, False), ("deadlock", True, False)]
    out = capsys.readouterr().out
    parts = [
        "(deadlock)",
        ">  19  ",
        "deadlock runs",
        "Why  ",
        "the cure)",
        "deadlock runs",
        "Cure  ",
    ]
    assert [part for part in parts if part not in out] == []
    assert out.index("Why  ") < out.index("the cure)") < out.index("Cure  ")


def test_cure_and_like_ros_choose_what_runs(capsys, played):
    assert main(["scene", "two-servers", "--like-ros"]) == 0
    assert main(["scene", "two-servers", "--cure"]) == 0
    assert played == [
        ("two-servers", False, True),
        ("two-servers", True, True),
        ("two-servers", True, False),
    ]
    assert "Both servers move the arm." in capsys.readouterr().out


def test_code_prints_the_program_and_runs_nothing(capsys, played):
    assert main(["scene", "deadlock", "--code", "--cure"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].endswith("cure.py")
    assert "    1  import rclpy" in out
    assert ">  21  " in out
    assert played == []


def test_unknown_scene_is_one_line(capsys):
    assert main(["scene", "deadlok"]) == 1
    err = capsys.readouterr().err
    assert err.startswith("there is no scene 'deadlok'; expected one of lost-reply")
    assert err.count("\n") == 1


def test_options_without_a_name_are_refused(capsys):
    assert main(["scene", "--cure"]) == 2
    assert "expected the name of a scene" in capsys.readouterr().err


def test_program_ends_if_nobody_reads_the_output(monkeypatch, played):
    ended = []

    async def play(scene, report, **_):
        report(Moment(0.0, "program", "begins"))
        try:
            await asyncio.sleep(100)
        finally:
            ended.append(scene.name)

    def moment(*_):
        raise OSError("closed")

    monkeypatch.setattr(player, "play", play)
    monkeypatch.setattr(Screen, "moment", moment)
    assert main(["scene", "deadlock"]) == 1
    assert ended == ["deadlock"]
