"""The page of the scenes: two scenes, as a lecturer shows them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.browser.chromium import LAPTOP, PHONE

MOMENTS = "#scene_panel .scene_moments li"
TEXTS = "#scene_panel .scene_texts"
LOOKS = {
    "laptop": {"size": LAPTOP, "color_scheme": "light"},
    "dark": {"size": LAPTOP, "color_scheme": "dark"},
    "phone": {"size": PHONE, "color_scheme": "light"},
}


@pytest.fixture
def url():
    """The address of the page of `taskrpc scene --page`."""
    options = ["--page", "--port", "0", "--no-browser"]
    command = [sys.executable, "-m", "taskrpc", "scene", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as serving:
        yield serving.stdout.readline().split()[-1].partition("?")[0]
        serving.terminate()
        assert serving.wait(20) == 0


def button(tab, text):
    """Press a button as soon as no program runs."""
    buttons = "return [...document.querySelectorAll('#scene_panel button')]"
    find = f"{buttons}.find(node => node.textContent === arguments[0] && !node.disabled)"
    tab.wait(lambda: tab.run(find, text), f"the button {text}").click()


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
    button(tab, "Run again")
    tab.wait(lambda: "call_async" in marked(tab), "the program with the mistake")
    assert "I wanted one task, and this is number 2" in shown(tab)


def test_deadlock_like_ros_ends_by_itself(tabs, url):
    tab = tabs.open(f"{url}?scene=deadlock&projector")
    button(tab, "Like ROS 2")
    assert shown(tab)[-1].startswith("still waits after 3.5 s")
    assert tab.text(TEXTS).startswith("You see\nThe program hangs")
    assert not tab.shows("#bottom_panel"), "no call leaves the program"


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_page_can_be_read_by_everybody(tabs, url, look):
    tab = tabs.open(f"{url}?scene=forgot-return", **look)
    button(tab, "Run")
    shown(tab)
    assert tab.violations() == []
    assert not tab.run("return document.body.scrollWidth > innerWidth")


def test_list_leads_to_the_scenes(tabs, url):
    tab = tabs.open(f"{url}?scene=")
    assert len(tab.all("#scene_panel .scene_list a")) == 10
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
    tab.wait(lambda: len(tab.all("#scene_panel .scene_list a")) == 10, "the list of scenes")
