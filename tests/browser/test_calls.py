"""The calls of the live page: their lanes, and what is said when there are none."""

from __future__ import annotations

import pytest

import taskrpc

# The number of calls in the drawing, and whether the text is hidden.
_STATE = """return [
    document.querySelectorAll("#calls .moving > g:first-of-type > *").length,
    document.getElementById("calls_empty").hidden,
]"""
_LABELS = "return [...document.querySelectorAll(arguments[0])].map(each => each.textContent)"
_MOVED = "return new DOMMatrix(getComputedStyle(document.querySelector('.moving')).transform).e"


@pytest.mark.slow
def test_page_shows_the_note_without_calls_again_when_the_last_call_has_left(
    start_server, services, open_page
):
    page = open_page(start_server())
    page.tab.wait(lambda: page.tab.shows("#calls_empty"), "the text before the first call")
    services.call("/list")
    page.tab.wait(lambda: not page.tab.shows("#calls_empty"), "the first call")
    page.tab.wait(lambda: not page.tab.run(_STATE)[0], "the call to leave the drawing")
    assert page.tab.run(_STATE) == [0, False]


def test_browser_moves_the_calls_between_two_frames_of_the_page(start_server, services, open_page):
    page = open_page(start_server())
    services.call("/list")
    page.tab.wait(
        lambda: page.tab.run("return document.querySelector('.moving').getAnimations().length"),
        "the calls to move",
    )
    page.tab.run("globalThis.requestAnimationFrame = () => 0")  # no frame of the page from now on
    before = page.tab.run(_MOVED)
    page.tab.wait(lambda: page.tab.run(_MOVED) < before - 1, "the calls to move on")


def test_service_and_result_of_a_failed_call_fit_at_the_end_of_its_lane(
    start_server, services, open_page
):
    page = open_page(start_server("--fault", "slow:1s,first=1,service=/robot_task/pause"))
    with pytest.raises(taskrpc.DeadlineExceeded):
        services.call("/pause", timeout=0.2)
    ends = ".lane_lasts li:first-child span"
    page.tab.wait(lambda: "✕" in "".join(page.tab.texts(ends)), "the failed call")
    assert page.tab.texts(ends)[0] == "/pause"
    assert page.tab.texts("#stats dt")[-1] == "error"
    widths = page.tab.run(
        "return [...document.querySelectorAll(arguments[0])]"
        ".map(each => [each.scrollWidth, each.clientWidth])",
        ends,
    )
    assert all(needed <= given for needed, given in widths), widths


def test_lost_response_ends_at_the_deadline_and_the_retry_gets_the_stored_response(
    start_server, services, open_page
):
    page = open_page(start_server("--fault", "lose-response:first=1"))
    request = {"task_type": "move", "target": "3,4", "priority": 8, "request_id": "monday-1"}
    with pytest.raises(taskrpc.DeadlineExceeded):
        services.call(**request, timeout=2.4)
    lost = ".notable[data-tone=bad] text"
    page.tab.wait(lambda: page.tab.run(_LABELS, lost) == ["✕ DEADLINE_EXCEEDED"], "the lost call")
    response = services.call(**request)
    assert response.success
    saved = ".notable:not([data-tone=bad]) text"
    page.tab.wait(lambda: page.tab.run(_LABELS, saved) == ["retry 1, stored response"], "the retry")
    shown = page.agrees(services, until=lambda shown: shown.running is not None)
    assert (shown.running[0], shown.queue) == (response.task_id, [])  # the task was queued once


_LOADED = (
    "return performance.getEntriesByType('resource').map(e => e.name)"
    ".filter(name => /slow_motion|frames|recording/.test(name)).map(name => name.split('/').at(-1))"
)


def test_slow_motion_is_loaded_when_it_is_used_first(start_server, services, open_page):
    page = open_page(start_server("--speed", "0.05"))
    services.submit()
    page.agrees(services, until=lambda shown: shown.running is not None)
    assert page.tab.run(_LOADED) == []
    page.tab.keys(".")
    page.tab.wait(lambda: "sends a request" in page.tab.text("#message_text"), "the first message")
    assert page.tab.run(_LOADED) == ["slow_motion.js"]
    assert page.tab.text("#step") == "Next message"
    page.tab.click("#live_calls")
    page.tab.wait(lambda: not page.tab.shows("#live_calls"), "the live calls")
    page.tab.click("#slow_motion")
    pressed = "#slow_motion[aria-pressed=true]"
    page.tab.wait(lambda: page.tab.all(pressed), "the slow motion")
    services.call("/list")
    page.tab.wait(lambda: "responds" in page.tab.text("#message_text"), "the messages of the call")
    assert page.tab.run(_LOADED) == ["slow_motion.js"]


def test_page_without_a_server_says_that_slow_motion_cannot_be_loaded(
    start_server, open_page, tabs
):
    server = start_server()
    page = open_page(server)
    tabs.expect("ERR_CONNECTION", "ERR_INCOMPLETE_CHUNKED_ENCODING")
    server.kill()
    page.tab.wait(lambda: page.read()["connection"] == "lost", "the connection to be lost")
    page.tab.keys("m")
    page.tab.wait(
        lambda: "the server does not answer" in page.tab.text("#message_text"), "the reason"
    )
