"""The live page of a server of a fleet: every robot, and which robot runs which task."""

from __future__ import annotations

import time

import pytest

from tests.postgres import why_missing

pytestmark = pytest.mark.skipif(bool(why_missing()), reason=why_missing())


def until(condition, seconds=40):
    ends = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < ends, "it does not happen"
        time.sleep(0.1)


def test_page_shows_the_robots_of_a_fleet_and_which_one_runs_which_task(
    start_server, open_page, services, postgres_url
):
    options = "--db", postgres_url, "--speed", "0.05"
    server = start_server(*options, "--robot-name", "robot_1")
    start_server(*options, "--robot-name", "robot_2")
    page = open_page(server, control=True)
    for target in ("warehouse", "station_1", "area_a"):
        services.submit("move", target, 5)

    def robots():
        script = "return [...document.querySelectorAll('#fleet li')].map(li => li.textContent)"
        return page.tab.run(script)

    until(lambda: len(robots()) == 2 and all("running move" in each for each in robots()))
    assert [each.partition(":")[0] for each in robots()] == ["robot_1", "robot_2"]
    marks = "return [...document.querySelectorAll('.other_robots text')].map(t => t.textContent)"
    until(lambda: page.tab.run(marks) == ["robot_2"])
    clients = "return [...document.querySelectorAll('#queue .client')].map(c => c.textContent)"
    assert all(each.startswith("robot_") for each in page.tab.run(clients))
    services.call("/pause", robot="robot_2")
    until(lambda: robots()[1].startswith("robot_2: paused"))
    assert robots()[0].startswith("robot_1: running")
