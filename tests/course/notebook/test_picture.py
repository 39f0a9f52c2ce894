import xml.etree.ElementTree as ET

import pytest

from taskrpc.course.notebook.calls import EndedCall
from taskrpc.course.notebook.picture import Shown, html, text
from taskrpc.observe.top.model import Pose, TaskRow, TaskServerRow
from taskrpc.robot.mapfile import default_world

RUNNING = TaskRow(1, "move warehouse", 5, "RUNNING", 0.25, 7.5, "/ana")
WAITING = TaskRow(2, "scan <b>", 9, "QUEUED", 0.0, 12.25, "/ben")
SERVER = TaskServerRow("/robot_task", False, 1, (RUNNING, WAITING), Pose(1.5, 2.0, 0.0))
CALL = EndedCall(1, 0.0, "/ana", "/add", "OK", 1.5)
FAILED = EndedCall(2, 0.0, "", "/robot_task", "DEADLINE_EXCEEDED", 2000.0)
WORLD = default_world()


def drawing(shown):
    """The SVG in the picture, parsed: it must be well formed."""
    page = html(shown)
    return ET.fromstring(page[page.index("<svg") : page.index("</svg>") + len("</svg>")])


def test_text_lists_robot_queue_and_calls():
    lines = text(Shown(WORLD, SERVER, calls=(FAILED, CALL))).splitlines()
    assert lines[:2] == ["/robot_task: working, 1 in the queue", "robot at 1.50,2.00"]
    assert lines[2].split() == ("1 move warehouse priority 5 running, 25%, done in 7.5 s".split())
    assert lines[5].endswith("this notebook -> /robot_task  DEADLINE_EXCEEDED  2000 ms")
    assert lines[6].endswith("/ana -> /add  OK  1.5 ms")


def test_html_is_well_formed_and_escapes_names():
    page = html(Shown(WORLD, SERVER, calls=(CALL,)))
    ET.fromstring(page)
    assert "scan &lt;b&gt;" in page
    assert "<script" not in page
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")


def test_map_has_the_robot_where_it_is():
    robot = next(each for each in drawing(Shown(WORLD, SERVER)) if "transform" in each.attrib)
    scale = 380 / WORLD.size[0]
    place = f"{1.5 * scale:.1f},{(WORLD.size[1] - 2.0) * scale:.1f}"
    assert robot.attrib["transform"] == f"translate({place})"


def test_map_names_all_places():
    names = {each.text for each in drawing(Shown(WORLD, SERVER)).iter() if each.text}
    assert names >= set(WORLD.places)


def test_target_of_the_running_task_is_marked():
    def targets(server):
        return [each for each in drawing(Shown(WORLD, server)) if each.get("r") == "9"]

    assert len(targets(SERVER)) == 1
    unknown = TaskRow(3, "move nowhere", 5, "RUNNING", 0.0, 1.0, "")
    assert targets(TaskServerRow("/robot_task", tasks=(unknown,))) == []
    assert targets(TaskServerRow("/robot_task", tasks=(WAITING,))) == []


def test_failed_call_is_marked():
    assert html(Shown(WORLD, calls=(CALL,))).count("#d84315") == 0
    assert html(Shown(WORLD, calls=(FAILED,))).count("#d84315") == 5


def test_long_queue_is_shortened():
    tasks = tuple(TaskRow(i, "move dock", 5, "QUEUED", 0.0, i, "") for i in range(1, 31))
    page = html(Shown(WORLD, TaskServerRow("/robot_task", False, 30, tasks)))
    assert "and 20 more" in page
    assert page.count("move dock") == 10


@pytest.mark.parametrize(
    ("server", "line"),
    [
        (None, "no task server is running"),
        (TaskServerRow("/robot_task", problem="no answer"), "/robot_task: no answer"),
        (TaskServerRow("/robot_task"), "/robot_task: idle, no task waits"),
        (TaskServerRow("/robot_task", paused=True), "/robot_task: paused, no task waits"),
    ],
)
def test_state_is_said_in_words(server, line):
    assert text(Shown(WORLD, server)) == line
    assert line in html(Shown(WORLD, server))
