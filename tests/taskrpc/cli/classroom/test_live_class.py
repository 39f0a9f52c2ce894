"""The live page shows the students of a class: connected or not, last seen, number of calls."""

import time

import pytest

from taskrpc.classroom.attendance import Attendance
from taskrpc.classroom.register import Register
from taskrpc.cli.classroom import command_line
from taskrpc.cli.classroom.live_class import LiveClass
from taskrpc.cli.main import main
from taskrpc.web.calls import AccountCalls


@pytest.fixture
def register(tmp_path):
    made = Register(tmp_path / "class")
    made.add(["ada", "José", "grace"], time.time() + 1000)
    return made


def test_students_have_their_names_calls_and_connections(register):
    accounts = [account.name for account in register.accounts()]
    calls = {accounts[1]: AccountCalls(3, 1234.5)}
    shown = LiveClass(register.folder, calls, lambda: {"ada"})()
    assert shown == [
        {"name": "ada", "last_seen": None, "calls": 0, "connected": True},
        {"name": "José", "last_seen": 1234.5, "calls": 3, "connected": False},
        {"name": "grace", "last_seen": None, "calls": 0, "connected": False},
    ]


def test_last_call_before_the_server_started_is_shown(register):
    attendance = Attendance(register.attendance_file, lambda: 99.0)
    attendance.call_began(type("Call", (), {"principal": "ada"}))
    attendance.node_ended(None)
    assert LiveClass(register.folder, {}, set)()[0]["last_seen"] == 99.0


def test_revoked_students_are_left_out_and_new_ones_appear(register):
    live = LiveClass(register.folder, {}, set)
    register.revoke("ada")
    register.add(["zoe"], time.time() + 1000)
    assert [student["name"] for student in live()] == ["José", "grace", "zoe"]


@pytest.mark.parametrize(
    ("given", "place"),
    [(["--web"], "127.0.0.1:0"), (["--web", "127.0.0.1:8642"], "127.0.0.1:8642")],
)
def test_class_with_a_page_starts_its_server(monkeypatch, given, place):
    served = []
    monkeypatch.setattr("taskrpc.cli.server.main", lambda argv: served.append(argv) or 0)
    assert main(["classroom", "--address", "192.0.2.7", *given]) == 0
    [arguments] = served
    assert arguments[arguments.index("--web") + 1] == place
    folder = arguments[arguments.index("--class") + 1]
    assert folder == str(command_line._register().folder)
