"""The page of the scenes: two scenes, as a lecturer shows them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from taskrpc.course.scenes.catalogue import SCENES
from tests.browser.chromium import LAPTOP, PHONE
from tests.browser.legible import SCHEMES, all_faults, faults

MOMENTS = "#scene_panel .scene_moments li"
TEXTS = "#scene_panel .scene_texts"


@pytest.fixture(scope="module")
def url():
    """The address of the page of `taskrpc scene --page`, which shows the last run."""
    options = ["--page", "--port", "0", "--no-browser"]
    command = [sys.executable, "-m", "taskrpc", "scene", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as serving:
        yield serving.stdout.readline().split()[-1].partition("?")[0]
        serving.terminate()
        assert serving.wait(20) == 0


def button(tab, text):
    """Press a button as soon as no program runs; it may say `again`, after another test's run."""
    buttons = "return [...document.querySelectorAll('#scene_panel button:enabled')]"
    find = f"{buttons}.find(node => node.textContent.replace(/ again$/, '') === arguments[0])"
    tab.wait(lambda: tab.run(find, text), f"the button {text}").click()


def chosen(tab):
    """The button whose program the page shows."""
    found = tab.texts("#scene_panel button[data-chosen]")
    return found[0] if found else None


def shown(tab):
    """What the page shows once the program has ended."""
    tab.wait(lambda: "Why" in tab.text(TEXTS) or "Cure" in tab.text(TEXTS), "the explanation", 60)
    return [text.split("\n")[-1] for text in tab.texts(MOMENTS)]


def marked(tab):
    return tab.text("#scene_panel [data-marked] code")


def test_retry_runs_the_task_twice_and_with_an_id_once(tabs, url):
    tab = tabs.open(f"{url}?scene=retry-without-id")
    assert tab.text("#scene_panel h2") == "A retry runs the task twice"
    assert marked(tab) == "future = client.call_async(request)"
    assert tab.text(TEXTS).startswith("Predict")
    button(tab, "Run")
    moments = shown(tab)
    assert moments[0] == "call 1: the request arrives"
    assert moments[-1] == "executes task 2"
    assert "the robot executes two" in tab.text(TEXTS)
    calls = "return document.querySelectorAll('#calls .notable').length"
    tab.wait(lambda: tab.run(calls), "the lost call in its lane")
    assert "/operator" in tab.text("#calls .lane_names")
    button(tab, "The cure")
    tab.wait(lambda: "request_id" in marked(tab), "the corrected program")
    assert "I wanted one task, and this is number 1" in shown(tab)
    assert tab.text(TEXTS).startswith("Cure")
    assert "Run again" in tab.texts("#scene_panel button")
    button(tab, "Run")
    tab.wait(lambda: "call_async" in marked(tab), "the program with the mistake")
    assert "I wanted one task, and this is number 2" in shown(tab)


def test_deadlock_like_ros_ends_by_itself(tabs, url):
    tab = tabs.open(f"{url}?scene=deadlock&projector")
    button(tab, "Like ROS 2")
    assert shown(tab)[-1].startswith("still waits after 3.5 s")
    assert tab.text(TEXTS).startswith("You see\nThe program hangs")
    assert not tab.shows("#bottom_panel"), "no call leaves the program"


def test_page_can_be_read_by_everybody(tabs, url):
    tab = tabs.open(f"{url}?scene=forgot-return")
    button(tab, "Run")
    shown(tab)
    for size in (LAPTOP, PHONE):
        tab.size(*size)
        assert not tab.run(
            "return document.body.scrollWidth > document.documentElement.clientWidth"
        ), size
        for scheme in SCHEMES:
            tab.prefer(color_scheme=scheme)
            assert tab.violations() == [], (size, scheme)


def test_list_leads_to_the_scenes(tabs, url):
    tab = tabs.open(f"{url}?scene=")
    tab.wait(
        lambda: len(tab.all("#scene_panel .scene_list a")) == len(SCENES), "the list of scenes"
    )
    tab.click("#scene_panel .scene_list a")
    assert tab.text("#scene_panel h2") == "The response is lost"
    tab.click("#scene_panel [aria-label='next scene']")
    tab.wait(lambda: tab.text("#scene_panel h2") == "The response is late", "the next scene")


def test_page_of_a_task_server_says_how_to_start_the_scenes(tabs, start_server):
    tabs.expect("scene.js")
    tab = tabs.open(f"{start_server().url}?scene=deadlock")
    assert "taskrpc scene --page" in tab.text("#no_scenes")


def test_address_without_a_scene_leads_to_the_list(tabs, url):
    tab = tabs.open(url)
    tab.wait(
        lambda: len(tab.all("#scene_panel .scene_list a")) == len(SCENES), "the list of scenes"
    )


@pytest.mark.parametrize("scene", [each.name for each in SCENES])
def test_each_scene_fits_on_a_projector(tabs, url, scene):
    link = f"{url}?scene={scene}&projector"
    tab = tabs.open(link, reduced_motion="reduce")
    tab.find("#scene_panel .primary")
    found = all_faults(tab, "before")
    for name in ("Run", "Like ROS 2", "The cure"):
        button(tab, name)
        tab.wait(lambda name=name: chosen(tab) in (name, f"{name} again"), "the program")
        assert shown(tab)
        found += all_faults(tab, name)
    for each in (f"{url}?scene={scene}", link):
        tab.open(each)
        tab.wait(lambda: tab.texts(MOMENTS), "the last run")
        found += all_faults(tab, "loaded again")
    assert not found, "\n".join(found)
    assert tab.violations() == []


PLANTED = {
    "find('.scene_texts dd').style.cssText = 'overflow: hidden; height: 4px'": "cut",
    "find('#scene_panel h2').style.cssText = 'width: 40px; overflow: hidden'": "cut",
    "find('.scene_code').style.cssText = 'overflow: auto; height: 60px'": "scrolls",
    "find('#scene_panel h2').textContent = 'the `return`'": "backtick",
    "find('.lane_names li').style.visibility = 'hidden'": "lanes",
}


@pytest.mark.parametrize("planted", PLANTED)
def test_measuring_finds_a_planted_fault(tabs, url, planted):
    tab = tabs.open(f"{url}?scene=lost-reply&projector")
    tab.find("#scene_panel .primary")
    tab.wait(lambda: tab.texts("#calls .lane_names li"), "a lane")
    assert faults(tab) == []
    tab.run(f"const find = css => document.querySelector(css); {planted}")
    assert any(PLANTED[planted] in each for each in faults(tab))


def test_turning_the_pages_many_times_leaves_no_connection_open(tabs, url):
    tab = tabs.open(f"{url}?scene={SCENES[0].name}")
    for scene in SCENES[1:]:
        tab.click("#scene_panel [aria-label='next scene']")
        title = scene.title.replace("`", "")
        tab.wait(lambda title=title: tab.text("#scene_panel h2") == title, title)


def test_calls_of_a_scene_stay_in_their_lanes_after_its_end(tabs, url):
    tab = tabs.open(f"{url}?scene=lost-reply")
    button(tab, "Run")
    shown(tab)
    tab.wait(lambda: tab.all("#calls .notable"), "the lost call in its lane")
    place = "return document.querySelector('#calls .moving').style.transform"
    at_end = tab.wait(lambda: tab.run(place), "the lanes to stand still")
    moved = "return document.querySelector('#calls .moving').getAnimations().length"
    assert tab.run(moved) == 0
    tab.run("dispatchEvent(new Event('resize'))")
    assert tab.run(place) == at_end
    assert tab.texts("#calls .lane_names li")[-1] == "server"
