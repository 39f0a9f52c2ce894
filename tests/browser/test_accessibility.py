"""The live page is usable by everybody: axe-core, keyboard, colours, motion, and small screens."""

from __future__ import annotations

import time

import pytest

from tests.browser.chromium import LAPTOP, PHONE
from tests.browser.legible import SCHEMES

KEY = {"Enter": "\ue007", "Escape": "\ue00c", "Tab": "\ue004", "Down": "\ue015", "Up": "\ue013"}
KEY |= {"Right": "\ue014", "Delete": "\ue017", "Space": " "}

LOOKS = {
    "with buttons": {"control": True},
    "projector": {"query": "?projector"},
    "phone": {"control": True, "size": PHONE},
    "read-only phone": {"size": PHONE},
}


def submit(services):
    """Queue tasks of every kind: ended, interrupted by a cancel, running and queued."""
    services.submit("move", "dock", 10)  # the robot is there, so it has ended at once
    for target, priority in (("station_1", 8), ("area_a", 5), ("central", 3)):
        services.submit("scan", target, priority)
    services.call("/cancel", task_id=3)
    while services.show(1).state != "SUCCEEDED":
        time.sleep(0.05)


@pytest.mark.parametrize("look", LOOKS)
def test_axe_finds_no_violation(busy, services, open_page, look):
    page = open_page(busy, **LOOKS[look])
    page.agrees(services, until=lambda shown: len(shown.queue) == 1 and len(shown.ended) == 2)
    page.tab.run("document.getElementById('done').open = true")
    for view in ("calls", "list", "nodes"):
        page.tab.run("document.getElementById(arguments[0]).click()", f"tab_{view}")
        for scheme in SCHEMES:
            page.tab.prefer(color_scheme=scheme)
            assert page.tab.violations() == [], (view, scheme)


@pytest.mark.parametrize("dialog", ["task", "help"])
def test_axe_finds_no_violation_in_dialogs(busy, services, open_page, dialog):
    page = open_page(busy, control=True)
    page.agrees(services, until=lambda shown: len(shown.queue) == 1)
    page.tab.click("#help" if dialog == "help" else "#now_title")
    page.tab.wait(lambda: page.tab.shows(f"#{dialog}_dialog"), "the dialog")
    for scheme in SCHEMES:
        page.tab.prefer(color_scheme=scheme)
        assert page.tab.violations() == [], scheme


def test_axe_finds_no_violation_in_a_page_without_tasks(start_server, open_page):
    page = open_page(start_server())
    for size in (LAPTOP, PHONE):
        page.tab.size(*size)
        assert page.tab.violations() == [], size


def test_axe_finds_no_violation_in_a_page_without_a_connection(start_server, open_page, tabs):
    server = start_server()
    page = open_page(server)
    tabs.expect("ERR_CONNECTION", "ERR_INCOMPLETE")
    server.kill()
    page.tab.wait(lambda: page.tab.text("#banner"), "the banner")
    assert page.tab.violations() == []


def focused(page):
    return page.tab.run(
        "const e = document.activeElement;return e.id || e.dataset.task || e.className || e.tagName"
    )


def test_everything_is_done_by_keyboard(start_server, services, open_page):
    server = start_server("--speed", "0.05")
    for _ in range(3):
        services.submit()
    page = open_page(server, control=True)
    page.agrees(services, until=lambda shown: shown.running is not None)
    tab = page.tab

    def tab_to(css):
        for _ in range(40):
            if tab.run("return document.activeElement.matches(arguments[0])", css):
                return
            tab.keys(KEY["Tab"])
        pytest.fail(f"the Tab key does not reach {css}; it reached {focused(page)}")

    tab_to("#submit_target")
    tab.keys("dock")
    tab_to("#submit_priority")
    tab_to("#submit")
    tab.keys(KEY["Enter"])
    page.agrees(services, until=lambda shown: len(shown.queue) == 3)
    tab_to("#pause")
    tab.keys(KEY["Space"])
    page.agrees(services, until=lambda shown: shown.paused)
    tab.keys(KEY["Space"])
    page.agrees(services, until=lambda shown: not shown.paused)
    tab_to("#queue .row")
    assert focused(page) == "2"
    tab.keys(KEY["Down"])
    assert focused(page) == "3"
    tab.keys("+")
    page.agrees(services, until=lambda shown: shown.queue[0][0] == 3)
    assert focused(page) == "3"
    tab.keys(KEY["Delete"])
    page.agrees(services, until=lambda shown: [row[0] for row in shown.queue] == [2, 4])
    tab.keys(KEY["Escape"])
    tab.keys("?")
    tab.wait(lambda: tab.shows("#help_dialog"), "the list of keys")
    tab.keys(KEY["Escape"])
    tab.wait(lambda: not tab.shows("#help_dialog"), "the list of keys to close")
    tab_to("#tab_calls")
    tab.keys(KEY["Right"])
    assert tab.shows("#list")


def test_focus_is_always_visible(busy, services, open_page):
    page = open_page(busy, control=True)
    page.agrees(services, until=lambda shown: len(shown.queue) == 1)
    seen = set()
    for _ in range(40):
        page.tab.keys(KEY["Tab"])
        name = focused(page)
        if name in seen or name == "BODY":
            continue
        seen.add(name)
        outline = page.tab.run(
            "const s = getComputedStyle(document.activeElement);"
            "return [s.outlineStyle, parseFloat(s.outlineWidth), s.boxShadow]"
        )
        visible = (outline[0] != "none" and outline[1] >= 2) or outline[2] != "none"
        assert visible, (name, outline)
    assert len(seen) >= 10


def test_end_of_a_task_is_announced(start_server, services, open_page):
    page = open_page(start_server("--speed", "0.5"))
    page.agrees(services)
    services.submit("move", "1.1,1.1")
    page.tab.wait(
        lambda: page.tab.run("return document.getElementById('announcements').textContent"),
        "an announcement",
    )
    said = page.tab.run("return document.getElementById('announcements').textContent")
    assert said == "Task 1, move 1.1,1.1: succeeded."


def test_nothing_is_animated_with_reduced_motion(start_server, services, open_page):
    page = open_page(start_server("--speed", "0.05"), reduced_motion="reduce")
    page.tab.run(
        "globalThis.animated = []; const {animate} = Element.prototype;"
        "Element.prototype.animate = function (...all) {"
        " animated.push(this.id || this.className); return animate.apply(this, all); };"
        "for (const kind of ['animationstart', 'transitionrun'])"
        " document.addEventListener(kind, event => animated.push(event.target.className), true)"
    )
    for _ in range(4):
        services.submit()
    services.submit("move", "dock", 10)
    services.call("/reprioritise", task_id=4, priority=9)
    services.call("/cancel", task_id=2)
    page.agrees(services, until=lambda shown: 2 in [row[0] for row in shown.ended])
    assert page.tab.run("return animated") == []


WIDEST = """
return [...document.querySelectorAll('body, body *')].filter(e => e.checkVisibility?.())
    .filter(e => e.getBoundingClientRect().right > innerWidth + 1)
    .filter(e => !e.closest('svg, .visually_hidden'))
    .filter(e => { for (let p = e.parentElement; p; p = p.parentElement)
        if (getComputedStyle(p).overflowX !== 'visible') return false; return true; })
    .map(e => e.id || e.className)
"""


def test_no_width_needs_horizontal_scrolling(busy, services, open_page):
    page = open_page(busy, control=True)
    page.agrees(services, until=lambda shown: len(shown.queue) == 1)
    for width in (320, 390, 600, 768, 1024, 1280, 1920):
        page.tab.size(width, 800)
        page.tab.run_async(
            "await new Promise(done => requestAnimationFrame(() => setTimeout(done)))"
        )
        widest = page.tab.run(WIDEST)
        assert page.tab.run("return document.documentElement.scrollWidth") <= width, widest
        assert widest == [], width


def test_phone_shows_map_then_task_then_queue_and_calls_behind_a_tab(busy, services, open_page):
    page = open_page(busy, size=PHONE)
    page.agrees(services, until=lambda shown: len(shown.queue) == 1)
    tops = page.tab.run(
        "return ['map', 'now', 'queue'].map("
        "id => document.getElementById(id).getBoundingClientRect().top)"
    )
    assert tops == sorted(tops)
    assert not page.tab.shows("#calls")
    page.tab.click("#phone_tabs [data-part='calls']")
    page.tab.wait(lambda: page.tab.shows("#calls"), "the calls")


def test_projector_hides_controls_and_doubles_the_text(busy, services, open_page):
    plain = open_page(busy, control=True)
    large = open_page(busy, control=True, query="?projector")
    large.agrees(services, until=lambda shown: len(shown.queue) == 1)
    assert not large.tab.shows("#submit_form")
    size = "return parseFloat(getComputedStyle(document.querySelector('#now_title')).fontSize)"
    assert large.tab.run(size) >= 1.7 * plain.tab.run(size)


def test_text_on_a_projector_has_the_same_share_of_each_screen(start_server, open_page):
    page = open_page(start_server(), query="?projector")
    share = "return parseFloat(getComputedStyle(document.body).fontSize) / innerHeight"
    expected = page.tab.run(share)
    page.tab.size(1920, 1080)
    assert page.tab.run(share) == pytest.approx(expected, rel=0.01)


def test_theme_button_switches_and_is_remembered(start_server, open_page):
    page = open_page(start_server(), color_scheme="light")
    colour = "return getComputedStyle(document.body).backgroundColor"
    before = page.tab.run(colour)
    page.tab.click("#theme")
    page.tab.wait(lambda: page.tab.run(colour) != before, "other colours")
    after = page.tab.run(colour)
    page.tab.run("location.reload()")
    page.is_live()
    assert page.tab.run(colour) == after
