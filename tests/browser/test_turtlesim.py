"""turtlesim's web page shows what the node draws, sends keys, and admits a lost connection."""

from __future__ import annotations

import re
from contextlib import closing

import pytest
from selenium.webdriver.common.keys import Keys

from taskrpc.ros.turtlesim.drawing.web_view import WebView
from taskrpc.ros.turtlesim.world import CENTRE, World
from tests.browser.chromium import PHONE
from tests.browser.legible import all_faults
from tests.ros.turtlesim.running import turtlesim_in

REFUSED = ("ERR_CONNECTION_REFUSED", "ERR_INCOMPLETE_CHUNKED_ENCODING", "ERR_CONNECTION_RESET")
"""What Chromium reports of a server that has ended."""

SET_PEN, TELEPORT = "turtlesim/srv/SetPen", "turtlesim/srv/TeleportAbsolute"

_PIXEL = """
const [x, y] = arguments;
return [...document.getElementById("lines").getContext("2d").getImageData(x, y, 1, 1).data];
"""
_GREEN = """
const canvas = document.getElementById("turtles"), scale = canvas.width / 500;
const [x, y] = [arguments[0] * scale, arguments[1] * scale];
const [red, green, blue, alpha] = canvas.getContext("2d").getImageData(x, y, 1, 1).data;
return alpha === 255 && green > red && green > blue;
"""
_FILTER = "return getComputedStyle(document.querySelector('main')).filter"
_PAPER = "return getComputedStyle(document.getElementById('paper')).backgroundColor"
_BACK = "return getComputedStyle(document.body).backgroundColor"
_OVERFLOW = "const page = document.documentElement; return page.scrollWidth - page.clientWidth"


@pytest.fixture
def turtlesim(tmp_path, monkeypatch, capsys):
    with turtlesim_in(tmp_path, monkeypatch, capsys) as turtlesim:
        yield turtlesim


class Simulator:
    """A turtlesim node with its page."""

    def __init__(self, turtlesim, *options):
        self.program, _ = turtlesim.run("turtlesim_node", "--view", "page", *options)
        self.program.wait_for("#control=")
        self.url = re.search(r"http://\S+", self.program.err)[0]
        self.link, _, self.token = self.url.partition("#")
        self.port = self.link.rpartition(":")[2].strip("/")


@pytest.fixture
def simulator(turtlesim):
    return Simulator(turtlesim, "--port", "0")


@pytest.fixture
def tab(simulator, tabs):
    tabs.expect("willReadFrequently")  # only these tests read the canvas back
    return is_live(tabs.open(simulator.url))


def is_live(tab):
    tab.wait(lambda: tab.text("#connection_text") == "live", "the connection to be live")
    tab.wait(lambda: tab.texts("#poses tr"), "the first turtle")
    return tab


def rows(tab):
    return [text.split() for text in tab.texts("#poses tr")]


def test_page_shows_turtles_pens_and_background_as_they_change(turtlesim, simulator, tab, tabs):
    def call(*line):
        turtlesim.command("service", "call", *line)

    assert tab.run(_PAPER) == "rgb(69, 86, 255)"
    assert tab.run(_GREEN, 250, 250)
    call("/spawn", "turtlesim/srv/Spawn", "{x: 2, y: 2, theta: 1.5708, name: ada}")
    tab.wait(lambda: [row[0] for row in rows(tab)] == ["ada", "turtle1"], "the second turtle")
    assert rows(tab)[0] == ["ada", "2.00", "2.00", "1.57", "3", "px"]
    tab.wait(lambda: tab.run(_GREEN, 90, 395), "the head of a turtle that looks up")
    call("/ada/set_pen", SET_PEN, "{r: 255, g: 196, b: 61, width: 5}")
    call("/ada/teleport_absolute", TELEPORT, "{x: 4, y: 2}")
    tab.wait(lambda: tab.run(_PIXEL, 135, 409) == [255, 196, 61, 255], "the line of the pen")
    call("/ada/set_pen", SET_PEN, "{off: 1}")
    call("/ada/teleport_absolute", TELEPORT, "{x: 8, y: 2}")
    tab.wait(lambda: rows(tab)[0] == ["ada", "8.00", "2.00", "0.00", "off"], "the pen to be off")
    assert tab.run(_PIXEL, 270, 409) == [0, 0, 0, 0]
    turtlesim.command("param", "set", "/turtlesim", "background_r", "150")
    tab.wait(lambda: tab.run(_PAPER) == "rgb(150, 86, 255)", "the new background")
    later = is_live(tabs.open(simulator.link))
    later.wait(lambda: later.run(_PIXEL, 135, 409) == [255, 196, 61, 255], "the earlier line")
    call("/clear", "std_srvs/srv/Empty")
    for each in (tab, later):
        each.wait(lambda each=each: each.run(_PIXEL, 135, 409)[3] == 0, "an empty picture")
    call("/reset", "std_srvs/srv/Empty")
    tab.wait(lambda: [row[0] for row in rows(tab)] == ["turtle1"], "the reset")
    call("/kill", "turtlesim/srv/Kill", "{name: turtle1}")
    tab.wait(lambda: tab.shows("#none"), "the text without turtles")


def test_keys_and_buttons_drive_the_turtle_only_with_the_link(turtlesim, simulator, tab, tabs):
    assert turtlesim.command("node", "list") == "/turtlesim\n"
    tab.keys(Keys.ARROW_UP)
    tab.wait(lambda: float(rows(tab)[0][1]) > 6, "the turtle to drive")
    tab.wait(lambda: tab.run(_PIXEL, 255, 249)[3] == 255, "its line")
    assert turtlesim.command("node", "list") == "/teleop_turtle\n/turtlesim\n"
    tab.keys("r")
    tab.wait(lambda: abs(float(rows(tab)[0][3]) - 1.57) < 0.03, "the turtle to look up")
    tab.click("[data-key='up']")
    tab.wait(lambda: float(rows(tab)[0][2]) > 6, "the turtle to drive up")
    tab.run("sessionStorage.clear()")
    shown = is_live(tabs.open(simulator.link))
    assert not shown.shows("[data-key='up']:enabled")
    assert "only shows" in shown.text("#drive_text")


def test_page_is_grey_without_the_node_and_live_again_with_a_new_one(
    turtlesim, simulator, tab, tabs
):
    assert tab.run(_FILTER) == "none"
    turtlesim.command(
        "service", "call", "/turtle1/teleport_absolute", TELEPORT, "{x: 9, y: 5.544445}"
    )
    tab.wait(lambda: tab.run(_PIXEL, 300, 250)[3] == 255, "a line")
    tabs.expect(*REFUSED)
    assert simulator.program.interrupt() == 0
    tab.wait(lambda: tab.text("#connection_text") == "connection lost", "the connection to be lost")
    assert re.search(r"since \d\d:\d\d:\d\d: the server is ending", tab.text("#banner"))
    assert tab.run(_FILTER) == "grayscale(1)"
    assert not tab.shows("[data-key='up']:enabled")
    Simulator(turtlesim, "--port", simulator.port)
    is_live(tab)
    tab.wait(lambda: tab.run(_PIXEL, 300, 250)[3] == 0, "the new, empty picture")
    assert not tab.shows("#banner")
    assert "only shows" in tab.text("#drive_text")  # the new node has another token


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_is_accessible_and_fits_a_phone(simulator, tabs, scheme):
    for size in (PHONE, (1280, 720)):
        tab = is_live(tabs.open(simulator.url, size=size, color_scheme=scheme))
        assert tab.violations() == []
        assert tab.run(_OVERFLOW) <= 0
    before = tab.run(_BACK)
    tab.click("#theme")
    assert tab.run(_BACK) != before
    tab.run("localStorage.clear()")


@pytest.mark.parametrize("names", [(), ("turtle1",), ("a_turtle_with_a_long_name", "turtle1")])
@pytest.mark.parametrize("is_for_control", [True, False])
def test_page_can_be_read_and_fits_a_projector_and_a_laptop(tabs, names, is_for_control):
    world = World()
    for number in range(len(names) and 40):
        name = names[number] if number < len(names) else f"turtle_{number}"
        world.spawn(name, CENTRE, CENTRE, -3.0).set_pen((255, 196, 61), 5, off=False)
    with closing(WebView(0)) as view:
        tab = tabs.open(view.url if is_for_control else view.url.partition("#")[0])

        def drawn():
            view.show(world, (69, 86, 255), "/turtlesim")
            return len(tab.texts("#poses tr")) == min(len(names) and 40, 12)

        tab.find('[data-state="live"]')
        tab.wait(drawn, "the turtles")
        found = all_faults(tab)
        tab.open("about:blank")
    assert not found, "\n".join(found)
