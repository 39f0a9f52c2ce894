"""The lines that a projector shows."""

import pytest

from taskrpc.cli.course.scene.screen import Screen
from taskrpc.course.scenes.catalogue import SCENES, scene
from taskrpc.course.scenes.moments import Moment
from taskrpc.course.scenes.player import excerpt, program_path
from taskrpc.course.scenes.scene import Line

DEADLOCK = scene("deadlock")


def test_title_names_scene_and_part():
    screen = Screen()
    assert screen.title(DEADLOCK, cure=False, like_ros=True)[0].endswith("(deadlock, like ROS 2)")
    assert screen.title(DEADLOCK, cure=True, like_ros=True)[0].endswith("(deadlock, the cure)")


def test_code_has_numbers_and_a_mark():
    lines = [Line(9, "if a:", False), Line(10, "", False), Line(11, "    b()", True)]
    assert Screen().code(lines) == ["    9  if a:", "   10", ">  11      b()", ""]


def test_long_text_takes_four_lines():
    lines = Screen(60).moment(Moment(1.26, "taskrpc", "why " * 100))
    assert len(lines) == 4
    assert lines[0].startswith(" 1.3 s  taskrpc  why why")
    assert lines[1].startswith(" " * 17 + "why")
    assert lines[3].endswith(" …")


@pytest.mark.parametrize("columns", [80, 120])
def test_circle_of_the_deadlock_is_shown_until_it_closes(columns):
    circle = (
        "ROS 2 would hang here for ever: Client.call in a callback waits in a circle:"
        " Doubler.double() (service /double) of /doubler -> /add -> the only thread that spins"
        " /doubler -> Doubler.double() (service /double) of /doubler"
    )
    advice = "; make the callback `async def` and await client.call_async(request)" * 3
    lines = Screen(columns).moment(Moment(0.0, "taskrpc", circle + advice))
    shown = " ".join(line[17:] for line in lines)
    assert shown == f"{circle} …"


def test_long_line_of_a_program_continues_below_its_beginning():
    line = Line(9, "    total = first_of_all(arguments) + second_of_all(arguments)", is_marked=True)
    assert Screen(50).code([line]) == [
        ">   9      total = first_of_all(arguments) +",
        "               second_of_all(arguments)",
        "",
    ]


def test_explanation_says_what_both_systems_do():
    lines = Screen().explanation(DEADLOCK, cure=False, like_ros=False)
    assert [line.split()[0] for line in lines if line and line[0] != " "] == ["You", "ROS", "Why"]
    like_ros = Screen().explanation(DEADLOCK, cure=False, like_ros=True)
    assert like_ros[1] == f"You see   {DEADLOCK.ros}"


def test_what_ros_2_does_can_stand_alone():
    assert not [each.name for each in SCENES if each.ros.startswith("The same")]


def test_lines_have_colours_only_on_request():
    plain = Screen().moment(Moment(0.0, "robot", "executes task 1"))
    coloured = Screen(coloured=True).moment(Moment(0.0, "robot", "executes task 1"))
    assert "\x1b" not in plain[0]
    assert "\x1b[32mrobot" in coloured[0]


def test_no_line_is_wider_than_a_projector():
    for each in SCENES:
        for cure in (False, True):
            program = program_path(each, cure=cure).read_text(encoding="utf-8")
            lines = [
                *Screen(80).title(each, cure=cure, like_ros=True),
                *Screen(80).explanation(each, cure=cure, like_ros=False),
            ]
            assert max(map(len, lines)) <= 80
            code = Screen(80).code(excerpt(each, cure=cure).lines(program))
            assert max(map(len, code)) <= 80
