"""The live page shows the students of a class: connected, stuck and why, calls, queued tasks."""

import time

import pytest

from taskrpc.cli.course.classroom import command_line
from taskrpc.cli.course.classroom.live_class import LiveClass
from taskrpc.cli.main import main
from taskrpc.core.observer import Connections
from taskrpc.course.classroom.attendance import Attendance
from taskrpc.course.classroom.register import Register
from taskrpc.observe.web.calls import AccountCalls, Problem


@pytest.fixture
def register(tmp_path):
    made = Register(tmp_path / "class")
    made.add(["ada", "José", "grace"], time.time() + 1000)
    return made


def connected(*accounts, **failed_lookups):
    """Returns the connections of these accounts."""
    return lambda: Connections(accounts=dict.fromkeys(accounts, 1), failed_lookups=failed_lookups)


def students(register, calls, presence=None, **settings):
    return LiveClass(register.folder, calls, presence or connected(), **settings)()


def test_students_have_their_names_calls_connections_and_queued_tasks(register):
    accounts = [account.name for account in register.accounts()]
    calls = {accounts[1]: AccountCalls(3, 1200.0, 1234.5, 2)}
    shown = students(
        register,
        calls,
        connected("ada"),
        queued=lambda: [accounts[1], "another", accounts[1]],
        wall_clock=lambda: 1300.0,
    )
    nothing = {"last_seen": None, "calls": 0, "queued": 0, "problem": None}
    assert shown == [
        nothing | {"name": "ada", "connected": True, "progress": "new", "begun": 1300.0},
        {
            "name": "José",
            "last_seen": 1234.5,
            "calls": 3,
            "connected": False,
            "queued": 2,
            "progress": "working",
            "begun": 1200.0,
            "problem": None,
        },
        nothing | {"name": "grace", "connected": False, "progress": "away", "begun": None},
    ]


def test_student_who_types_commands_counts_as_connected_for_a_minute_after_each(register):
    calls = {"ada": AccountCalls(1, 1000.0, 1000.0, 1)}
    times = iter([1059.0, 1060.0])
    live = LiveClass(register.folder, calls, connected(), wall_clock=lambda: next(times))
    assert [live()[0]["connected"], live()[0]["connected"]] == [True, False]


def test_student_without_a_successful_call_is_stuck_after_two_minutes(register):
    problem = Problem("/robot_task", "DEADLINE_EXCEEDED")
    calls = {"ada": AccountCalls(5, 1000.0, 1100.0, problem=problem)}
    times = iter([1119.0, 1120.0])
    live = LiveClass(register.folder, calls, connected(), wall_clock=lambda: next(times))
    assert live()[0]["progress"] == "new"
    shown = live()[0]
    assert (shown["progress"], shown["begun"]) == ("stuck", 1000.0)
    assert shown["problem"] == {
        "service": "/robot_task",
        "code": "DEADLINE_EXCEEDED",
        "message": "",
    }


@pytest.mark.parametrize(("exists", "code"), [(True, "TYPE_MISMATCH"), (False, "UNAVAILABLE")])
def test_service_that_a_student_looks_for_in_vain_is_the_problem(register, exists, code):
    calls = {"ada": AccountCalls(1, 1000.0, 1100.0, problem=Problem("/robot_task", "INTERNAL"))}
    shown = students(register, calls, connected(ada=("/robot_tsk", exists)))
    assert shown[0]["problem"] == {"service": "/robot_tsk", "code": code}


def test_next_group_begins_without_what_is_known_of_the_former_one(register):
    Attendance(register.attendance_file, lambda: 99.0).call_began(
        type("Call", (), {"principal": "ada"})
    )
    times = iter([1000.0, 2000.0])
    live = LiveClass(register.folder, {}, connected("ada"), wall_clock=lambda: next(times))
    assert live()[0]["last_seen"] == 99.0
    live.forget()
    row = live()[0]
    assert (row["last_seen"], row["begun"], row["progress"]) == (None, 2000.0, "new")


def test_last_call_before_the_server_started_is_shown(register):
    attendance = Attendance(register.attendance_file, lambda: 99.0)
    attendance.call_began(type("Call", (), {"principal": "ada"}))
    attendance.node_ended(None)
    assert students(register, {})[0]["last_seen"] == 99.0


def test_revoked_students_are_left_out_and_new_ones_appear(register):
    live = LiveClass(register.folder, {}, connected())
    register.revoke("ada")
    register.add(["zoe"], time.time() + 1000)
    assert [student["name"] for student in live()] == ["José", "grace", "zoe"]


@pytest.mark.parametrize(
    ("given", "place"),
    [(["--web"], "127.0.0.1:0"), (["--web", "127.0.0.1:8642"], "127.0.0.1:8642")],
)
def test_class_with_a_page_starts_its_server(monkeypatch, given, place):
    served = []
    monkeypatch.setattr(
        "taskrpc.cli.robot.server.command_line.main", lambda argv: served.append(argv) or 0
    )
    assert main(["classroom", "--address", "192.0.2.7", *given]) == 0
    [arguments] = served
    assert arguments[arguments.index("--web") + 1] == place
    folder = arguments[arguments.index("--class") + 1]
    assert folder == str(command_line._register().folder)
