"""The live page is honest about its connection: ends, restarts and faults of the server."""

from __future__ import annotations

from tests.browser.conftest import control_link
from tests.browser.live_page import LivePage

REFUSED = ("ERR_CONNECTION_REFUSED", "ERR_INCOMPLETE_CHUNKED_ENCODING", "ERR_CONNECTION_RESET")
"""What Chromium reports of a server that has ended."""

_FIGURES_FIT = """
return document.getElementById("stats").getBoundingClientRect().right <= innerWidth;
"""


def state(page):
    return page.read()["connection"]


def test_killed_server_is_reported_and_numbers_are_greyed(start_server, services, open_page, tabs):
    server = start_server("--speed", "0.05")
    services.submit()
    page = open_page(server)
    page.agrees(services, until=lambda shown: shown.running is not None)
    tabs.expect(*REFUSED)
    server.kill()
    page.tab.wait(lambda: state(page) == "lost", "the connection to be lost")
    page.tab.wait(lambda: "since" in page.tab.text("#banner").lower(), "the time of the loss")
    frozen = page.tab.texts("#now_text")
    for _ in range(3):
        page.tab.run_async("await new Promise(requestAnimationFrame)")
    assert page.tab.texts("#now_text") == frozen


def test_page_reconnects_to_a_restarted_server_and_says_so(
    start_server, services, open_page, tabs, tmp_path
):
    db = ("--db", str(tmp_path / "tasks.db"), "--speed", "0.05")
    server = start_server(*db)
    for _ in range(3):
        services.submit()
    page, large = open_page(server), open_page(server, query="?projector")
    page.agrees(services, until=lambda shown: shown.running is not None)
    tabs.expect(*REFUSED)
    server.kill()
    page.tab.wait(lambda: state(page) == "lost", "the connection to be lost")
    start_server(*db, web=server.web)
    assert large.is_live().tab.run(_FIGURES_FIT)
    page.is_live()
    assert "restarted" in page.tab.run("return document.body.innerText")
    shown = page.agrees(services, until=lambda shown: shown.running is not None)
    assert shown.running[0] == 2
    assert (1, "move warehouse", "INTERRUPTED", "/ada") in shown.ended


def test_control_page_can_only_show_after_a_restart(start_server, services, open_page, tabs):
    server = start_server()
    page = open_page(server, control=True)
    page.tab.wait(lambda: page.tab.shows("#submit"), "the buttons")
    tabs.expect(*REFUSED, "401")
    server.end()
    page.tab.wait(lambda: state(page) == "lost", "the connection to be lost")
    restarted = start_server(web=server.web)
    page.tab.wait(lambda: state(page) != "lost", "the page to hear of the new server")
    page.tab.wait(lambda: not page.tab.shows("#submit:enabled"), "no button to work")
    assert "taskrpc view" in page.tab.run("return document.documentElement.outerHTML")
    LivePage(tabs.open(control_link(restarted))).is_live().tab.click("#pause")
    services.call("/resume")


def test_page_shows_why_the_server_ends(start_server, open_page, tabs):
    server = start_server()
    page = open_page(server)
    tabs.expect(*REFUSED)
    server.end()
    page.tab.wait(lambda: state(page) == "lost", "the connection to be lost")
    page.tab.wait(lambda: "ending" in page.tab.text("#banner").lower(), "the reason")


def test_button_pressed_while_the_server_dies_says_that_the_outcome_is_unknown(
    start_server, open_page, tabs
):
    server = start_server()
    page = open_page(server, control=True)
    page.tab.wait(lambda: page.tab.shows("#submit"), "the buttons")
    tabs.expect(*REFUSED)
    # The click comes before the page can notice the end of the stream.
    page.tab.run("window.press = () => document.getElementById('pause').click()")
    page.tab.run(
        "const {fetch} = window; window.fetch = (...all) => String(all[0]).includes('/control/')"
        " ? Promise.reject(new TypeError('network')) : fetch(...all); window.press()"
    )
    assert "unknown" in page.said()
    server.kill()


def test_two_tabs_show_the_same_and_each_button_acts_for_both(start_server, services, open_page):
    server = start_server("--speed", "0.05")
    for priority in (5, 5, 5):
        services.submit(priority=priority)
    first, second = open_page(server, control=True), open_page(server)
    first.agrees(services, until=lambda shown: shown.running is not None)
    second.agrees(services)
    first.tab.click("#queue [data-task='3'] [data-verb='raise']")
    for page in (first, second):
        page.agrees(services, until=lambda shown: shown.queue[0][0] == 3)
    first.tab.click("#stop")
    for page in (second, first):
        page.agrees(services, until=lambda shown: shown.paused and shown.running is None)


HIDE = """
Object.defineProperty(document, "hidden", {value: arguments[0], configurable: true});
document.dispatchEvent(new Event("visibilitychange"));
"""
"""A headless tab is always visible, so the test says for the browser that it is hidden."""


def test_hidden_tab_ends_its_stream_and_is_live_again_when_it_is_shown(
    start_server, services, open_page
):
    page = open_page(start_server("--speed", "0.05"))
    page.tab.run(HIDE, True)
    page.tab.wait(lambda: state(page) == "asleep", "the hidden tab to end its stream")
    services.submit()
    assert page.shown().running is None
    page.tab.run(HIDE, False)
    page.is_live().agrees(services, until=lambda shown: shown.running is not None)
