"""What the live page shows of the tasks is what the services say, before and after each button."""

from __future__ import annotations

import json
import math

import pytest

from taskrpc.cli.shared.page_link import noted_links
from tests.browser.chromium import PHONE
from tests.browser.live_page import LivePage

SLOW = ("--speed", "0.05")
"""The robot works so slowly that no task ends during a test."""


@pytest.fixture
def page(start_server, services, open_page):
    """The page for control of a slow robot: task 1 is running, tasks 2 to 4 wait."""
    server = start_server(*SLOW)
    for target, priority in (("warehouse", 5), ("station_1", 5), ("area_a", 5), ("central", 4)):
        services.submit("move", target, priority)
    page = open_page(server, control=True)
    page.agrees(services, until=lambda shown: shown.running is not None)
    return page


def ids(shown):
    return [row[0] for row in shown.queue]


def test_page_shows_the_tasks_that_the_services_list(page, services):
    shown = page.agrees(services)
    assert shown.running == (1, "move warehouse", "RUNNING", 5, "/ada")
    assert ids(shown) == [2, 3, 4]


def test_submit_button_queues_the_task(page, services):
    page.tab.run("document.getElementById('submit_type').value = 'scan'")
    page.tab.find("#submit_target").send_keys("1.5, 2")
    page.tab.find("#submit_priority").clear()
    page.tab.find("#submit_priority").send_keys("10")
    page.tab.click("#submit")
    assert page.said().startswith("Task queued: scan")
    shown = page.agrees(services, until=lambda shown: len(shown.queue) == 4)
    assert shown.queue[0] == (5, "scan 1.5, 2", "QUEUED", 10, "/web_page")


def test_refused_task_is_said_in_the_words_of_the_service(page, services):
    before = page.agrees(services)
    page.tab.find("#submit_target").send_keys("nowhere")
    page.tab.click("#submit")
    expected = services.call(task_type="move", target="nowhere", priority=5)
    assert not expected.success
    assert page.said() == expected.message
    assert page.agrees(services) == before


def test_cancel_button_of_a_row_cancels_that_task(page, services):
    page.tab.click("#queue [data-task='3']")
    page.tab.keys("\ue00c")  # Escape closes the details again
    page.tab.click("#queue [data-task='3'] [data-verb='cancel']")
    shown = page.agrees(services, until=lambda shown: ids(shown) == [2, 4])
    assert services.show(3).state == "CANCELED"
    assert shown.ended == [(3, "move area_a", "CANCELED", "/ada")]


def test_cancel_button_of_the_details_cancels_the_running_task(page, services):
    page.tab.click("#now_title")
    page.tab.wait(lambda: "warehouse" in page.tab.text("#task_dialog"), "the details")
    page.tab.click("#task_dialog footer button")
    page.agrees(services, until=lambda shown: [row[0] for row in shown.ended] == [1])
    assert services.show(1).state == "CANCELED"


def test_pause_button_halts_the_queue_and_resume_continues(page, services):
    assert page.tab.text("#pause") == "Pause"
    page.tab.click("#pause")
    shown = page.agrees(services, until=lambda shown: shown.paused)
    assert shown.running[2] == "PAUSED"
    page.tab.wait(lambda: page.tab.text("#pause") == "Resume", "the button to say Resume")
    page.tab.click("#pause")
    shown = page.agrees(services, until=lambda shown: not shown.paused)
    assert shown.running[2] == "RUNNING"
    page.tab.wait(lambda: page.tab.text("#pause") == "Pause", "the button to say Pause")


def test_arrow_buttons_change_the_priority_and_the_order(page, services):
    page.tab.click("#queue [data-task='4'] [data-verb='raise']")
    page.agrees(services, until=lambda shown: shown.queue[2][3] == 5)
    page.tab.click("#queue [data-task='4'] [data-verb='raise']")
    page.agrees(services, until=lambda shown: ids(shown) == [4, 2, 3])
    page.tab.click("#queue [data-task='2'] [data-verb='lower']")
    page.agrees(services, until=lambda shown: ids(shown) == [4, 3, 2])
    assert (services.show(4).priority, services.show(2).priority) == (6, 4)


def test_reason_of_a_later_estimate_stands_beside_the_task(page, services):
    services.submit("move", "dock", 10)
    reason = page.tab.wait(
        lambda: page.tab.texts("#queue [data-task='2'] .reason.shown"), "a reason"
    )
    assert "task 5" in reason[0]
    assert reason[0].startswith("+")


_COVERED = """
const row = document.querySelector("#queue .row:has(.reason.shown)");
const boxes = [...row.children].filter(e => e.checkVisibility())
    .map(e => e.getBoundingClientRect());
const covers = (a, b) =>
    Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
    && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > row.clientHeight / 8;
return boxes.some((a, i) => boxes.slice(i + 1).some(b => covers(a, b)))
    || row.scrollHeight > row.clientHeight + 1;
"""


@pytest.mark.parametrize("look", [{}, {"query": "?projector"}, {"size": PHONE}])
def test_reason_covers_no_other_text_of_its_row(start_server, services, open_page, look):
    page = open_page(start_server(*SLOW), control=True, **look)
    for target in ("warehouse", "1.2345678901234567,2.3456789012345678"):
        services.submit("move", target)
    page.agrees(services, until=lambda shown: shown.running is not None)
    services.submit("move", "dock", 10)
    page.tab.wait(lambda: page.tab.all("#queue .reason.shown"), "a reason")
    assert not page.tab.run(_COVERED)


def test_stop_button_halts_the_robot_and_pauses_the_queue(page, services):
    page.tab.click("#stop")
    shown = page.agrees(services, until=lambda shown: shown.paused and shown.running is None)
    assert [row[:3] for row in shown.ended] == [(1, "move warehouse", "CANCELED")]
    assert ids(shown) == [2, 3, 4]
    assert "paused" in page.tab.text("#now").lower()


def test_details_show_what_the_service_says_of_a_task(page, services):
    services.submit("report", "dock", 10)
    page.agrees(services, until=lambda shown: len(shown.queue) == 4)
    page.tab.click("#queue [data-task='2'] .what")
    said = services.show(2)
    assert said.estimate_changes
    for change in said.estimate_changes:
        page.tab.wait(lambda: change.cause in page.tab.text("#task_dialog"), change.cause)  # noqa: B023
    text = page.tab.text("#task_dialog")
    for words in ("task 2", "move station_1", "/ada"):
        assert words in text


def test_result_of_an_ended_task_is_shown(start_server, services, open_page):
    page = open_page(start_server("--speed", "50"))
    services.submit("report", "dock")
    page.agrees(services, until=lambda shown: len(shown.ended) == 1)
    page.tab.run("document.getElementById('done').open = true")
    page.tab.click("#ended .link")
    result = json.loads(services.show(1).result)
    battery = str(round(result["battery"], 3)).removesuffix(".0")
    page.tab.wait(lambda: battery in page.tab.text("#task_dialog"), f"battery {battery}")


def test_robot_stands_where_the_services_say_it_stands(start_server, services, open_page):
    page = open_page(start_server("--speed", "50"))
    services.submit("move", "2,3")
    page.agrees(services, until=lambda shown: len(shown.ended) == 1)
    end = json.loads(services.show(1).result)["pose"]
    x, y = end["x"], end["y"]
    assert math.hypot(x - 2, y - 3) < 0.1
    page.tab.wait(
        lambda: f"{x:.1f}" in page.tab.text("#pose") and f"{y:.1f}" in page.tab.text("#pose"),
        "the pose",
    )


def test_calls_of_all_clients_are_listed(page, services):
    page.tab.click("#tab_list")
    services.show(2)
    page.tab.wait(
        lambda: any("ada" in row and "/show" in row for row in page.tab.texts("#call_table tr")),
        "the call of /robot_task/show",
    )


def test_nodes_are_shown_with_their_services(page):
    page.tab.click("#tab_nodes")
    for words in ("task_server", "ada", "/robot_task"):
        page.tab.wait(lambda: words in page.tab.text("#nodes"), words)  # noqa: B023


def test_empty_page_shows_a_command_to_try(start_server, open_page):
    page = open_page(start_server())
    page.tab.wait(lambda: "taskrpc-call /robot_task" in page.tab.text("#queue_empty"), "a command")


def test_page_of_the_second_robot_shows_and_drives_only_this_robot(start_server, services, tabs):
    server = start_server(*SLOW, "--robots", "2")
    services.submit()
    links = {link.service: link for link in noted_links()}
    page = LivePage(tabs.open(links["/robot2/robot_task"].control_link)).is_live()
    assert "/robot2/robot_task at " in page.tab.text("#title")
    assert page.shown().running is None
    page.tab.find("#submit_target").send_keys("central")
    page.tab.click("#submit")
    page.tab.wait(lambda: page.shown().running is not None, "the task of the second robot")
    assert page.shown().running[1] == "move central"
    first = LivePage(tabs.open(links["/robot_task"].control_link)).is_live()
    assert first.agrees(services, until=lambda shown: shown.running).running[1] == "move warehouse"
    assert server.process.poll() is None
