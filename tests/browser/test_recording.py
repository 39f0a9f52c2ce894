"""A real recording of a real run on the page: what it shows at each time is what the file says."""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys
import time

import pytest

from taskrpc.observe.recording.mcap_file import Recording
from taskrpc.observe.recording.timeline import Timeline
from tests.browser.chromium import LAPTOP, PHONE
from tests.browser.legible import SCHEMES
from tests.browser.live_page import LivePage, Shown
from tests.browser.task_server import Services, TaskServer
from tests.cli.ros.bag.conftest import recording  # noqa: F401 (calls without a task server)

_BEGUN = ("RUNNING", "PAUSED", "CANCELING")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The recording of a task server with tasks of every kind, a pause and a cancel."""
    folder = tmp_path_factory.mktemp("run")
    server = TaskServer(folder, "--speed", "20", "--record", "run.mcap")
    try:
        with Services() as services:
            for target, priority in ("warehouse", 5), ("central", 5), ("station_1", 9), ("dock", 3):
                services.submit("scan", target, priority)
            services.submit("report", "dock", 1)
            services.call("/cancel", task_id=4)
            services.call("/pause")
            services.call("/list")
            services.call("/resume")
            while services.show(5).state != "SUCCEEDED":
                time.sleep(0.05)
    finally:
        server.end()
    return folder / "run.mcap"


@pytest.fixture(scope="module")
def link_to():
    """Starts `taskrpc view FILE` once for each file, and returns the link to its page."""
    links = {}
    with contextlib.ExitStack() as stack:

        def _link_to(path):
            if path not in links:
                command = [sys.executable, "-m", "taskrpc", "view", str(path), "--no-browser"]
                pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
                viewing = stack.enter_context(subprocess.Popen(command, **pipes, text=True))
                stack.callback(viewing.kill)
                links[path] = viewing.stdout.readline().split()[-1]
            return links[path]

        yield _link_to


@pytest.fixture
def view(tabs, link_to):
    """Opens the page of `taskrpc view FILE` and waits until it plays."""

    def _view(path, *, query="", **settings):
        page = LivePage(tabs.open(link_to(path) + query, **settings))
        page.tab.wait(lambda: page.tab.shows("#timeline"), "the time line")
        return page

    return _view


@pytest.fixture
def timeline(run):
    return Timeline(Recording(run))


def is_playing(page):
    return page.tab.run("return document.getElementById('play').title === 'Pause'")


def is_at(page, timeline, when):
    """Wait until the page shows a time."""
    share = (when - timeline.begin) / (timeline.end - timeline.begin)
    place = "return Number(document.getElementById('scrub').value)"
    page.tab.wait(
        lambda: math.isclose(page.tab.run(place), 1000 * share, abs_tol=0.01), f"the time {when}"
    )


def pause(page):
    page.tab.run("const b = document.getElementById('play'); if (b.title === 'Pause') b.click()")


def play_at(page, speed):
    """Choose the playback speed."""
    page.tab.run(
        "const s = document.getElementById('recording_speed'); s.value = arguments[0];"
        "s.dispatchEvent(new Event('change'))",
        speed,
    )


def seek(page, timeline, share):
    """Drag the time line to a share of its length; returns the time."""
    pause(page)
    page.tab.run(
        "const r = document.getElementById('scrub'); r.value = arguments[0];"
        "r.dispatchEvent(new Event('input'))",
        1000 * share,
    )
    return timeline.begin + share * (timeline.end - timeline.begin)


def recorded(timeline, when):
    """What the recording says of the tasks at a time; events at exactly that time count."""
    found = timeline.state_at(math.nextafter(when, math.inf)).get("tasks")
    if found is None:
        return None
    data = found.data

    def row(task):
        what = f"{task['task_type']} {task['target']}"
        return task["task_id"], what, task["state"], task["priority"], task["client"]

    running = data["running"] and row(data["running"])
    ended = [(*row(task)[:3], task["client"]) for task in data["ended"]]
    return Shown(data["paused"], running, [row(task) for task in data["queue"]], ended)


def agrees(page, timeline, when):
    """Wait until the page shows what the recording says."""
    expected = recorded(timeline, when)
    page.tab.run("document.getElementById('done').open = true")
    try:
        page.tab.wait(lambda: page.shown() == expected, "the page to agree with the recording")
    except AssertionError as error:
        raise AssertionError(f"shown    {page.shown()}\nrecorded {expected}\n{error}") from error


def test_each_time_shows_the_queue_and_the_tasks_of_the_recording(run, view, timeline):
    page = view(run)
    for share in (0.9, 0.15, 0.5, 0.02, 0.3, 0.7, 1.0):
        agrees(page, timeline, seek(page, timeline, share))


def test_robot_stands_where_the_recording_says(run, view, timeline):
    page = view(run)
    for share in (0.95, 0.4, 1.0):
        when = seek(page, timeline, share)
        robot = timeline.state_at(math.nextafter(when, math.inf))["robot"].data
        if robot["moving"] and share < 1.0:
            continue  # between two poses, the page shows a pose between them
        expected = f"x {robot['x']:.2f}", f"y {robot['y']:.2f}"
        page.tab.wait(
            lambda: all(each in page.tab.text("#robot_text") for each in expected),  # noqa: B023
            f"the pose {expected}",
        )
    path = [event for event in timeline if event.event == "robot"]
    end = page.tab.text("#robot_text")
    assert f"x {path[-1].data['x']:.2f}" in end


def test_play_runs_to_the_end_and_stops_there(run, view, timeline):
    page = view(run)
    play_at(page, 20)
    page.tab.wait(lambda: not is_playing(page), "the end")
    agrees(page, timeline, timeline.end)
    assert float(page.tab.run("return document.getElementById('scrub').value")) == 1000
    last = [event for event in timeline if event.event == "calls"][-1].data["stats"]
    assert page.tab.text("[data-stat='errors']") == str(last["errors"])
    play_at(page, 0.1)  # or the recording could end between two looks
    page.tab.keys(" ")  # from the beginning again
    page.tab.wait(lambda: is_playing(page), "the begin")


def test_pause_stands_still_and_steps_go_from_event_to_event(run, view, timeline):
    page = view(run)
    seek(page, timeline, 0.5)
    stops = sorted({event.t for event in timeline if event.event not in ("robot", "hello")})
    middle = timeline.begin + 0.5 * (timeline.end - timeline.begin)
    expected = [t for t in stops if t > middle + 1e-6][:3]
    for when in expected:
        page.tab.click("#step_forward")
        is_at(page, timeline, when)
        agrees(page, timeline, when)
    page.tab.click("#step_back")
    is_at(page, timeline, expected[1])
    still = page.tab.text("#recording_time")
    time.sleep(0.3)
    assert page.tab.text("#recording_time") == still


def test_details_show_the_recorded_result_and_changes(run, view, timeline):
    page = view(run)
    seek(page, timeline, 1.0)
    agrees(page, timeline, timeline.end)
    results = {event.data["task_id"]: event.data for event in timeline if event.event == "task"}
    page.tab.click("#ended [data-task='5'] .link")
    battery = f"{round(results[5]['result']['battery'], 3):g}"
    page.tab.wait(lambda: battery in page.tab.text("#task_dialog"), f"battery {battery}")
    for change in results[5]["changes"]:
        assert change["cause"] in page.tab.text("#task_dialog")
    assert page.tab.texts("#task_dialog footer button") == []
    page.tab.keys("\ue00c")
    page.tab.run("document.querySelector('#ended_more').click()")  # also the tasks that do not fit
    page.tab.click("#ended [data-task='1'] .link")
    page.tab.wait(lambda: page.tab.shows("#task_dialog .scan_result"), "the scan")


def test_empty_queue_of_a_recording_suggests_no_call(run, view, timeline):
    page = view(run)
    agrees(page, timeline, seek(page, timeline, 1.0))
    assert page.tab.text("#queue_empty") == "No task waits."


def test_details_before_the_end_of_a_task_have_no_result(run, view, timeline):
    page = view(run)
    begun = next(
        event.t
        for event in timeline
        if event.event == "tasks" and event.data["running"] and event.data["queue"]
    )
    seek(page, timeline, (begun - timeline.begin + 0.001) / (timeline.end - timeline.begin))
    page.tab.click("#queue .row .what")
    page.tab.wait(lambda: "submitted" in page.tab.text("#task_dialog"), "the details")
    assert "Result" not in page.tab.text("#task_dialog")


LOOKS = {"plain": {}, "projector": {"query": "?projector"}, "phone": {"size": PHONE}}


@pytest.mark.parametrize("look", LOOKS)
def test_axe_finds_no_violation(run, view, timeline, look):
    page = view(run, **LOOKS[look])
    seek(page, timeline, 0.6)
    page.tab.run("document.getElementById('done').open = true")
    for scheme in SCHEMES:
        page.tab.prefer(color_scheme=scheme)
        assert page.tab.violations() == [], scheme


def test_nothing_needs_horizontal_scrolling(run, view):
    tab = view(run).tab
    for size in (LAPTOP, PHONE, (320, 640)):
        tab.size(*size)
        assert tab.run("return document.documentElement.scrollWidth") <= size[0]


def test_unfinished_recording_says_so_on_the_page(run, view, tmp_path):
    data = run.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    page = view(tmp_path / "cut.mcap")
    assert page.tab.text("#banner").startswith("cut.mcap is not finished")
    pause(page)
    assert page.tab.violations() == []
    timeline = Timeline(Recording(tmp_path / "cut.mcap"))
    agrees(page, timeline, seek(page, timeline, 1.0))


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_recording_without_a_task_server_shows_its_calls_only(recording, view, size):  # noqa: F811
    page = view(recording, size=size)
    assert "has no decisions of a task server" in page.tab.text("#banner")
    for css in ("#map_panel", "#tasks_panel", "#phone_tabs"):
        assert not page.tab.shows(css)
    page.tab.click("#tab_list")
    page.tab.wait(lambda: "/add" in "".join(page.tab.texts("#call_table tr")), "the call")
    page.tab.click("#tab_nodes")
    page.tab.wait(lambda: "/add" in page.tab.text("#nodes"), "the service")
    assert page.tab.violations() == []


def test_page_of_a_recording_has_no_token_in_any_address(run, view):
    page = view(run)
    entries = page.tab.run("return performance.getEntriesByType('resource').map(e => e.name)")
    assert any(name.endswith("/recording") for name in entries)
    assert page.tab.url.endswith("/")
    assert page.tab.run("return sessionStorage.length") == 0
