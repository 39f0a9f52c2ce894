"""The recording of a simulated run on the page: its faults and its failure are marks."""

from __future__ import annotations

import re

import pytest

from taskrpc.simulation.interpreter.loop import FIRST_DAY
from taskrpc.simulation.run.trace import Event
from taskrpc.simulation.search.protocol import Contents, Explained, ToldCall
from taskrpc.simulation.search.recording import write
from tests.browser.test_recording import link_to, pause, view  # noqa: F401 (fixtures)

BEGIN, END = 0.0, 4.0
LOST, KILLED, AGAIN, FAILED = 0.5, 2.0, 3.0, END
"""Virtual seconds."""
MARKS = {
    LOST: ("violet", "FAULT: response 1 of /grasp lost"),
    KILLED: ("violet", "gripper is killed"),
    AGAIN: ("quiet", "gripper starts again"),
    FAILED: ("bad", "FAILED: one_grasp: the gripper grasped 2 times"),
}


@pytest.fixture
def recording(tmp_path):
    """A run with a lost response, a killed program and a failure at its end."""
    events = [
        Event(BEGIN, "gripper", "start", "starts"),
        Event(0.2, "gripper", "print", "grasping", "gripper.py:13"),
        Event(LOST, "gripper", "fault", "lose response 1 of /grasp"),
        Event(1.2, "student", "print", "no response: I try again", "student.py:19"),
        Event(KILLED, "gripper", "crash", "is killed"),
        Event(AGAIN, "gripper", "start", "starts again"),
        Event(FAILED, "student", "end", "ends with 0"),
    ]
    calls = [
        ToldCall(1, "student", "/grasp", 0.2, 1.2, "DEADLINE_EXCEEDED", 1.2),
        ToldCall(2, "student", "/grasp", 1.2, None, "OK", None),
    ]
    text = "the gripper grasped 2 times\ngrasp.sim.py:12  assert grasps <= 1"
    found = Explained(
        seed=15,
        kind="one_grasp",
        text=text,
        faults=[],
        groups=[],
        in_order=True,
        hash="",
        events=events,
        waits=[],
        failed_at=FAILED,
        contents=Contents(calls, {}, []),
    )
    path = tmp_path / "grasp.mcap"
    write(path, found)
    return path


def seek(page, t):
    """Drag the time line to a virtual time."""
    pause(page)
    page.tab.run(
        "const r = document.getElementById('scrub'); r.value = arguments[0];"
        "r.dispatchEvent(new Event('input'))",
        1000 * (t - BEGIN) / (END - BEGIN),
    )


def lane_marks(page):
    """The marks on the lanes, from left to right, with their distance from the right edge."""
    return page.tab.run(
        "const edge = document.querySelector('.track').getBoundingClientRect().right;"
        "return [...document.querySelectorAll('.note')].map(node => {"
        "  const box = node.querySelector('rect').getBoundingClientRect();"
        "  return [edge - (box.left + box.right) / 2, node.dataset.tone];"
        "})"
    )


def test_faults_and_failure_are_marks_at_their_times(recording, view):  # noqa: F811
    page = view(recording, query="")
    tab = page.tab
    assert not tab.shows("#banner")
    assert tab.run(
        "return [...document.querySelectorAll('.marks [data-kind]')].map("
        "  node => [parseFloat(node.style.left), node.dataset.tone, node.title])"
    ) == [
        [pytest.approx(100 * (t - BEGIN) / (END - BEGIN), abs=0.2), tone, f"{t:.3f} s: {text}"]
        for t, (tone, text) in MARKS.items()
    ]
    seek(page, END)
    tab.wait(lambda: len(lane_marks(page)) == len(MARKS), "the marks on the lanes")
    width = tab.run("return document.querySelector('.track').clientWidth")
    assert lane_marks(page) == [
        [pytest.approx((END - t) / 10 * width, abs=2), tone] for t, (tone, _) in MARKS.items()
    ]
    labels = tab.run("return [...document.querySelectorAll('.note text')].map(e => e.textContent)")
    assert "✕ one_grasp: the gripper grasped 2 times" in labels
    seek(page, 1.3)
    tab.wait(lambda: len(lane_marks(page)) == 1, "the time before the kill")
    line = "1.200 s student prints: no response: I try again (student.py:19)"
    tab.wait(lambda: tab.text("#message_text") == line, "the printed line")
    seek(page, END)
    failure = f"{END:.3f} s {MARKS[END][1]}"
    tab.wait(lambda: tab.text("#message_text") == failure, "the failure")
    assert tab.violations() == []


def test_page_of_a_simulation_begins_on_the_first_of_january(recording, view):  # noqa: F811
    page = view(recording)
    seek(page, BEGIN)
    begin = page.tab.run(
        "return new Date(arguments[0] * 1000).toLocaleTimeString('en-GB')", FIRST_DAY
    )
    page.tab.wait(lambda: re.match(begin, page.tab.text("#recording_time")), "the time of day")
