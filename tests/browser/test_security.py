"""The live page changes nothing without a token, and a task cannot put markup into it."""

from __future__ import annotations

import http.client
import json

import pytest

from tests.browser.conftest import control_link
from tests.observe.web.test_static import MOST_BYTES_AT_FIRST

ROBOT = """
import asyncio
from taskrpc.robot import Plan, Pose

class Anything:
    speed = 1.0
    task_types = ("move",)

    def plan(self, task_type, target, start):
        return Plan(1000.0, start)

    def pose(self):
        return Pose(0.0, 0.0, 0.0)

    async def execute(self, task_type, target, report):
        await asyncio.sleep(1000)

    def remaining(self):
        return 1000.0

    def pause(self):
        pass

    resume = stop = pause
"""
"""A robot without a map that accepts every target."""

MARKUP = [
    "<img src=x onerror=alert(1)>",
    "<script>alert(1)</script>",
    "</textarea><svg onload=alert(1)>",
    '"><b>bold</b>',
    "{{7*7}} ${7*7} &lt;b&gt;",
    "javascript:alert(1)",
]


def test_read_only_link_has_no_button_that_changes_anything(start_server, services, open_page):
    server = start_server("--speed", "0.05")
    for _ in range(3):
        services.submit()
    page = open_page(server)
    before = page.agrees(services, until=lambda shown: shown.running is not None)
    for css in ("#submit_form", "#stop", "#pause", "#queue [data-verb]"):
        assert not page.tab.shows(css), css
    assert page.tab.shows("#read_only")
    page.tab.click("#queue .row .what")
    page.tab.wait(lambda: page.tab.text("#task_dialog"), "the details")
    assert page.tab.texts("#task_dialog footer button") == []
    page.tab.keys("\ue00c")
    page.tab.run("document.querySelector('#queue .row').focus()")
    page.tab.keys("+", "-", "x", "\ue017", "p", " ", "s", "n")
    assert page.agrees(services)[:3] == before[:3]


def post(server, verb, *, request=None, **headers):
    host, port = server.web.split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=30)
    try:
        sent = {"Content-Type": "application/json"}
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request("POST", f"/control/{verb}", json.dumps(request or {}), sent)
        response = connection.getresponse()
        return response.status, response.read().decode()
    finally:
        connection.close()


def test_post_without_a_token_is_refused(start_server, services):
    server = start_server()
    for verb in ("submit", "cancel", "pause", "resume", "reprioritise", "stop"):
        for headers in ({}, {"Authorization": "Bearer wrong"}):
            status, body = post(server, verb, **headers)
            assert status == 401, (verb, body)
        assert not services.call("/list").paused, verb


def test_page_of_another_server_cannot_post(start_server, services, open_page, tabs):
    server, other = start_server(), start_server("--join")
    tabs.expect("Content Security Policy", "policy: ", "blocked by CORS", "Failed to load", "403")
    tab = open_page(other, control=True).tab
    token = control_link(server).partition("#control=")[2]
    with pytest.raises(RuntimeError):
        tab.run_async("await fetch(`${args[0]}control/pause`, {method: 'POST'})", server.url)
    status, _ = post(server, "pause", Origin=other.url.rstrip("/"), Authorization=f"Bearer {token}")
    assert status == 403


def test_token_is_taken_out_of_the_address_bar_and_never_sent_in_a_url(start_server, open_page):
    server = start_server("--log-level", "debug")
    page = open_page(server, control=True)
    page.tab.wait(lambda: page.tab.shows("#submit"), "the buttons")
    token = page.tab.run("return sessionStorage.getItem('taskrpc_token')")
    assert token
    assert page.tab.url == server.url
    assert token not in page.tab.run("return document.documentElement.outerHTML")
    requested = page.tab.run("return performance.getEntriesByType('resource').map(e => e.name)")
    assert requested
    assert not [url for url in requested if token in url]
    assert token not in server.text


def test_page_loads_nothing_from_elsewhere_and_little_in_all(start_server, open_page):
    server = start_server()
    page = open_page(server)
    entries = page.tab.run(
        "return performance.getEntriesByType('resource').concat(performance.getEntriesByType("
        "'navigation')).filter(e => !e.name.endsWith('/live'))"
        ".map(e => [e.name, e.decodedBodySize])"
    )
    assert all(name.startswith((server.url, "data:")) for name, _ in entries), entries
    assert 0 < sum(size for _, size in entries) <= MOST_BYTES_AT_FIRST


def test_markup_of_a_task_stays_text(start_server, services, open_page, tmp_path, monkeypatch):
    (tmp_path / "anything.py").write_text(ROBOT)
    server = start_server("--robot", "anything:Anything")
    page = open_page(server, control=True)
    for target in MARKUP:
        services.submit("move", target)
    shown = page.agrees(services, until=lambda shown: shown.running is not None)
    assert [shown.running[1], *(row[1] for row in shown.queue)] == [f"move {t}" for t in MARKUP]
    for task_id in range(1, len(MARKUP) + 1):
        css = "#now_title" if task_id == 1 else f"#queue [data-task='{task_id}'] .what"
        page.tab.click(css)
        target = MARKUP[task_id - 1]
        page.tab.wait(lambda: target in page.tab.text("#task_dialog"), target)  # noqa: B023
        page.tab.keys("\ue00c")
    services.call("/cancel", task_id=2)
    page.agrees(services, until=lambda shown: len(shown.ended) == 1)
    page.tab.find("#submit_target").send_keys(MARKUP[0])
    page.tab.click("#submit")
    page.agrees(services, until=lambda shown: len(shown.queue) == len(MARKUP) - 1)
    for css in ("main img", "main script", "main b", "dialog img", "dialog b", "#now svg[onload]"):
        assert page.tab.all(css) == [], css
