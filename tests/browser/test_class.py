"""The page of a class over TLS: the students, their buttons, and an account that only sees."""

from __future__ import annotations

import json
import re

import pytest
import trustme

import srvgen
import taskrpc
import taskrpc.sync
from taskrpc.course.classroom.class_server import ClassServer
from taskrpc.course.classroom.register import Register
from tests.browser.legible import SIZES, all_faults
from tests.browser.live_page import LivePage

LATER = 4e9  # seconds since 1970
SOON_STUCK = "import taskrpc.course.classroom.progress as progress; progress.STUCK_AFTER = 1.0"
"""Students count as stuck after one second instead of two minutes."""


@pytest.fixture
def register(tmp_path):
    """A class with a student and an account that only sees."""
    register = Register(tmp_path / "class")
    register.server = ClassServer(("127.0.0.1",), 7450)
    register.add(["ada", "guest@lab"], LATER)
    rows = json.loads(register.accounts_file.read_bytes())
    rows["accounts"]["guest@lab"] = {
        "secret": "a+secret/with~other=characters-",
        "role": "observe",
        "expires": LATER,
    }
    register.accounts_file.write_text(json.dumps(rows), encoding="utf-8")
    return register


@pytest.fixture
def server(register, tmp_path, start_server):
    """The server of the class, with a certificate that no browser knows."""
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    issued = authority.issue_cert("127.0.0.1")
    issued.private_key_pem.write_to_path(tmp_path / "key.pem")
    issued.cert_chain_pems[0].write_to_path(tmp_path / "cert.pem")
    options = {
        "--tls-cert": tmp_path / "cert.pem",
        "--tls-key": tmp_path / "key.pem",
        "--accounts": register.accounts_file,
        "--class": register.folder,
        "--speed": "0.05",
    }
    flat = [str(each) for pair in options.items() for each in pair]
    return start_server(*flat, web="0.0.0.0:0", first=SOON_STUCK)


@pytest.fixture
def open_as(register, server, tabs):
    """Opens the page with the link of an account; other accounts do not matter."""
    tokens = {account.name: account.token for account in register.accounts()}

    def page(name):
        url = f"{server.url}#view={tokens[name]}"
        return LivePage(tabs.open(url, any_certificate=True)).is_live()

    return page


@pytest.fixture
def ada(register, server, tmp_path):
    """The node of a student's program."""
    token = next(each.token for each in register.accounts() if each.name == "ada")
    place = re.search(r"ready: .* at (\S+)", server.text)[1]
    tls = taskrpc.Tls(ca=tmp_path / "ca.pem")
    with taskrpc.sync.Node("laptop", peers=[place], tls=tls, token=token) as node:
        yield node


def students(page):
    """The rows of the class tab."""
    return [text.split("\n") for text in page.tab.texts("#students > li")]


def test_student_submits_a_task_and_the_class_tab_counts_the_call(server, services, open_as):
    assert server.url.startswith("https://")
    page, screen = open_as("ada"), open_as("guest@lab")
    for each in (page, screen):
        each.tab.click("#tab_class")
        each.tab.wait(lambda each=each: len(students(each)) == 2, "the students")
        assert each.tab.text("#class p") == "0 of 2 students connected"
    page.tab.find("#submit_target").send_keys("warehouse")
    page.tab.click("#submit")
    shown = page.agrees(services, until=lambda shown: shown.running is not None)
    assert shown.running[4] == "ada"
    assert screen.agrees(services).running == shown.running
    for each in (page, screen):
        each.tab.wait(
            lambda each=each: each.tab.text("#class p") == "1 of 2 students connected", "ada"
        )
        row = "#students [data-student='ada']"
        each.tab.wait(
            lambda each=each: "1 call" in each.tab.text("#students [data-student='ada']"), row
        )


def test_class_tab_says_who_is_stuck_and_why(open_as, ada):
    page, row = open_as("guest@lab"), "#students [data-student='ada']"
    page.tab.click("#tab_class")
    robot_task = srvgen.load("my_robot_interfaces/srv/RobotTask")
    client = ada.create_client(robot_task, "/robot_task")
    request = robot_task.Request(task_type="fly", target="central", priority=5)
    assert not client.call(request).success
    page.tab.wait(lambda: "without a successful call" in page.tab.text(row), "a stuck student")
    assert "/robot_task: Invalid task: fly" in page.tab.text(row)
    assert page.tab.text("#class p").endswith("connected · 1 without a successful call")
    assert students(page)[0][0] == "ada"
    assert page.tab.violations() == []
    request.task_type = "scan"
    for _ in range(3):
        assert client.call(request).success
    page.tab.wait(lambda: "calls · 2 queued" in page.tab.text(row), "a working student")
    assert page.tab.text("#class p") == "1 of 2 students connected"


def test_projector_shows_the_class_and_no_buttons(server, register, tabs):
    token = next(each.token for each in register.accounts() if each.name == "ada")
    url = f"{server.url}?projector&view=class#view={token}"
    page = LivePage(tabs.open(url, any_certificate=True)).is_live()
    page.tab.wait(lambda: page.tab.shows("#students"), "the students")
    assert page.tab.shows("#class > p")
    for css in ("#submit_form", "#slow_motion", "#theme"):
        assert not page.tab.shows(css), css
    page.tab.click("#tab_calls")
    assert not page.tab.shows("#students")
    assert page.tab.violations() == []


def test_student_cannot_stop_the_robot_and_the_page_says_why(server, services, open_as, tabs):
    tabs.expect("403")
    services.submit()
    page = open_as("ada")
    page.agrees(services, until=lambda shown: shown.running is not None)
    page.tab.click("#stop")
    assert "operate" in page.said()
    assert page.agrees(services).running is not None


def test_account_with_the_role_observe_sees_everything_and_has_no_buttons(
    server, services, open_as
):
    for _ in range(3):
        services.submit()
    page = open_as("guest@lab")
    before = page.agrees(services, until=lambda shown: shown.running is not None)
    assert len(before.queue) == 2
    for css in ("#submit_form", "#stop", "#pause", "#queue [data-verb]"):
        assert not page.tab.shows(css), css
    assert page.tab.shows("#read_only")
    page.tab.click("#queue .row .what")
    page.tab.wait(
        lambda: "Why the estimate changed" in page.tab.text("#task_dialog"), "the details"
    )
    assert page.tab.texts("#task_dialog footer button") == []
    page.tab.keys("\ue00c")
    page.tab.run("document.querySelector('#queue .row').focus()")
    page.tab.keys("+", "-", "x", "\ue017", "p", " ", "s", "n")
    assert page.agrees(services)[:3] == before[:3]
    assert page.tab.url == server.url


def test_page_without_a_token_says_that_it_needs_one(server, tabs):
    tabs.expect("401")
    tab = tabs.open(server.url, any_certificate=True)
    tab.wait(lambda: "This page has no valid token" in tab.text("body"), "the reason")


@pytest.mark.parametrize("query", ["?projector&view=class", "?view=class"])
def test_class_of_thirty_can_be_read(register, server, services, tabs, query):
    register.add([f"student_{number:02}" for number in range(28)], LATER)
    token = next(each.token for each in register.accounts() if each.name == "ada")
    url = f"{server.url}{query}#view={token}"
    tab = LivePage(tabs.open(url, any_certificate=True, size=SIZES["projector"])).is_live().tab
    tab.wait(lambda: len(tab.all("#students > li")) == 30, "the students")
    found = all_faults(tab, "no task")
    for _ in range(12):
        services.submit()
    tab.wait(lambda: tab.shows("#now_title"), "the task that runs")
    found += all_faults(tab, "many tasks")
    assert not found, "\n".join(found)
